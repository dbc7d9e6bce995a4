"""Pictures and tables of the page "Navigation consequence", from the results of its studies.

``python docs/navigation_consequence.py results/gyro-navigation-static results/gyro-navigation-lake`` writes
the pictures into ``docs/images`` and prints the tables.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from comparisons.drawing import render
from comparisons.navigation_figures import (
    PERFECT,
    error_picture,
    navigation_curves,
    paired_table,
    track_picture,
)
from comparisons.store import ResultsStore
from navopt.models.earth import NAUTICAL_MILE

IMAGES = Path(__file__).resolve().parent / "images"
SCORES = {
    "gyro-navigation-static": ["position_error_max_nmi", "position_error_rms_nmi", "position_error_end_nmi"],
    "gyro-navigation-lake": ["position_error_max_m", "north_error_end_m", "east_error_end_m"],
}


def save(name: str, figure: Figure, dpi: int = 90) -> None:
    """Write a picture of the page."""
    IMAGES.mkdir(exist_ok=True)
    data = render(figure, format="png", dpi=dpi)
    (IMAGES / f"{name}.png").write_bytes(data)
    print(f"images/{name}.png: {len(data) / 1000:.0f} kB\n")


def tables(store: ResultsStore) -> None:
    """Medians with intervals, and differences to the turntable and between the swarms."""
    for score in SCORES[store.study.name]:
        for against in ("turntable, aged", "OAFSA"):
            print(score, "against", against)
            print(paired_table(store, score, against=against).to_string(float_format="%.3g"), "\n")


def main(arguments: Sequence[str]) -> None:
    """Write the pictures and print the tables of each folder of results."""
    for argument in arguments:
        print(f"## {argument}\n")
        with ResultsStore(argument) as store:
            tables(store)
            kind = store.study.name.rpartition("-")[2]
            for k, scenario in enumerate(store.study.scenarios):
                curves = navigation_curves(store, scenario)
                printed = {
                    value.solver: value.value
                    for value in store.study.printed
                    if value.score == "position_error_end_nmi" and value.scenario == scenario
                }
                if kind == "static":
                    picture = error_picture(curves, store.study, printed=printed)
                    save(f"navigation-{kind}-{k + 1}", picture, 80)
                perfect = curves.error_m[PERFECT] / (NAUTICAL_MILE if kind == "static" else 1.0)
                peak, end = (sorted(v)[len(v) // 2] for v in (perfect.max(axis=1), perfect[:, -1]))
                print(f"{scenario}: {PERFECT}: largest {peak:.3g}, at the end {end:.3g} (medians)")
                print(curves.per_hour().iloc[::3].to_string(float_format="%.2f"), "\n")
            if kind == "lake":
                save("navigation-tracks", track_picture(store, next(iter(store.study.scenarios)), 0), 80)


if __name__ == "__main__":
    main(sys.argv[1:])

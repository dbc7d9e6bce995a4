"""Picture and table of the page "Static alignment": ``python docs/static_alignment.py``."""

from __future__ import annotations

from pathlib import Path

from comparisons.alignment_bound import alignment_knowledge, alignment_picture, printed_alignment
from comparisons.drawing import render

IMAGES = Path(__file__).resolve().parent / "images"


def main() -> None:
    """Write the picture and print the tables."""
    table, raw = alignment_knowledge(), alignment_knowledge((5.0,), raw=True)
    data = render(alignment_picture(table, raw), format="png", dpi=90)
    (IMAGES / "static-alignment-yaw.png").write_bytes(data)
    print(f"images/static-alignment-yaw.png: {len(data) / 1000:.0f} kB\n")
    columns = ["duration_s", "yaw_initial_deg", "yaw_best_deg", "yaw_least_deg", "pitch_best_deg"]
    print(table[table["scale"] == 1.0][columns].to_string(index=False))
    print(raw.iloc[::4][["scale", *(f"{a}_actual_deg" for a in ("pitch", "yaw"))]].to_string(index=False))
    print(printed_alignment().to_string(index=False))


if __name__ == "__main__":
    main()

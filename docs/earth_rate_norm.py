"""Picture of the page "What the Earth-rate norm can see": ``python docs/earth_rate_norm.py``."""

from __future__ import annotations

from pathlib import Path

import navopt
from comparisons.drawing import render
from comparisons.null_directions_figure import null_directions_figure

IMAGES = Path(__file__).resolve().parent / "images"
WORLDS = {
    "all twelve": {"estimated": "all"},
    "six misalignments": {"estimated": "misalignment"},
    "in the frame of the sensors": {"estimated": "frame"},
    "with accelerometers": {"estimated": "all", "loss": "invariants"},
}


def main() -> None:
    worlds = {label: navopt.simulate("gyro-calibration", 0, **options) for label, options in WORLDS.items()}
    data = render(null_directions_figure(worlds), format="png", dpi=100)
    (IMAGES / "gyro-null-directions.png").write_bytes(data)
    print(f"images/gyro-null-directions.png: {len(data) / 1000:.0f} kB")


if __name__ == "__main__":
    main()

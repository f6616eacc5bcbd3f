"""python -m scenarios.gallery: a small picture of every scenario, for the README."""

from __future__ import annotations

import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from scenarios.catalogue import CATALOGUE
from scenarios.options import check_seed, parse_names
from slam.cli import InputError, main

COMMAND = "scenarios.gallery"
DPI = 110
COLOURS = 64
"""Of a picture: few enough to keep it small."""


@dataclass(frozen=True)
class Options:
    """Simulate scenarios and draw each from above, with the drive and where ManifoldSLAM found no match."""

    scenarios: Annotated[str, arg(metavar="A,B,…")] = ",".join(CATALOGUE)
    """Scenarios to draw, separated by commas."""
    seed: Annotated[int, arg(metavar="K")] = 0
    """Which drive of each."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("docs/gallery")
    """Folder for the pictures."""


def run(options: Options) -> None:
    """One PNG per scenario."""
    names = parse_names(options.scenarios, CATALOGUE, "scenario")
    check_seed(options.seed)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {options.out}: cannot be written: {error.strerror}") from error
    for name in names:
        path = options.out / f"{name}.png"
        path.write_bytes(picture(name, options.seed))
        print(path)


def picture(name: str, seed: int) -> bytes:
    """The world of a scenario from above, as a small PNG file."""
    from PIL import Image

    from scenarios.methods.baselines import wsm
    from scenarios.methods.config import MethodConfig
    from scenarios.report.style import png
    from scenarios.report.world_figures import draw_thumbnail
    from sim.record import simulate

    simulated = simulate(CATALOGUE[name], seed)
    figure = draw_thumbnail(simulated, wsm(simulated.recording, MethodConfig()))
    drawn, small = Image.open(io.BytesIO(png(figure, DPI))), io.BytesIO()
    drawn.convert("RGB").quantize(COLOURS).save(small, "PNG", optimize=True)
    return small.getvalue()


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))

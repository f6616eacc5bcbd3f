"""Templates, styles and scripts of the pages: our own, and the two libraries that draw (Leaflet, uPlot)."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import jinja2

HERE = Path(__file__).parent
VENDOR, TEMPLATES = HERE / "vendor", HERE / "templates"
MODULES = (
    "decode", "pose", "run", "theme", "elements", "raster", "map", "layers", "panel", "robot", "tilt",
    "chart", "measures", "stitches", "stitch", "time", "main",
)  # fmt: skip
"""Our scripts in the order they are read; what one defines, those after it use."""


def template(name: str, folder: Path = TEMPLATES) -> jinja2.Template:
    """A template of a folder, in which everything is escaped that is not marked as safe."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


@cache
def style() -> str:
    """All style sheets in one, without the images that Leaflet's would fetch."""
    sheets = [VENDOR / "leaflet.css", VENDOR / "uplot.css", TEMPLATES / "page.css"]
    return re.sub(r"url\([^)]*\)", "none", "\n".join(map(read, sheets)))


@cache
def script() -> str:
    """All scripts in one."""
    libraries = [read(VENDOR / f"{name}.js").partition("//# source")[0] for name in ("leaflet", "uplot")]
    own = "\n".join(read(TEMPLATES / "js" / f"{name}.js") for name in MODULES)
    return "\n".join([*libraries, f'(() => {{\n"use strict";\n{own}}})();'])


def theme_script() -> str:
    """What a page without a live map needs: the switch between light and dark."""
    own = read(TEMPLATES / "js" / "theme.js")
    return f'(() => {{\n"use strict";\n{own}\nthemeSwitch(document.getElementById("theme"));\n}})();'


def read(path: Path) -> str:
    """The text of a file."""
    return path.read_text(encoding="utf-8")

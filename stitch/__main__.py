"""python -m stitch a.yaml b.yaml -o merged: join ROS maps, tell how and how sure that is, or refuse."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from slam import se2
from slam.cli import POSE, InputError, Pose, RefusedError, main
from slam.formats import FormatError
from slam.mapping.submap import Submap
from slam.se2 import Array
from stitch.align import METHODS, AlignConfig, NoStitch, Prior, Stitch, align
from stitch.command import explain, maps, merge
from stitch.command.maps import as_json, as_text, in_words

if TYPE_CHECKING:
    Method = str
else:
    Method = Literal[tuple(METHODS)]

COMMAND = "stitch"
IMAGE_SUFFIXES = (".pgm", ".png", ".bmp", ".jpg", ".jpeg", ".tif", ".tiff")
PRIOR_SIGMA = (1.0, 1.0, math.radians(10.0))


@dataclass(frozen=True)
class Options:
    """Join two ROS maps: where the second lies in the frame of the first, how sure that is, both as one map.

    Poses are x, y, yaw in m and rad. Exit code 0: joined; 2: bad input; 3: not sure enough, nothing written.
    """

    maps: Positional[Annotated[tuple[Path, ...], arg(metavar="A.yaml B.yaml", help_behavior_hint="")]] = ()
    """Maps as map_server reads them; their resolutions may differ."""
    out: Annotated[Path | None, arg(aliases=["-o"], metavar="NAME", help_behavior_hint="")] = None
    """Write the merged map, in the frame of the first, to NAME.yaml and .pgm, and a picture to NAME.png."""
    prior: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """About where the second map lies in the frame of the first."""
    prior_sigma: Annotated[Pose | None, POSE, arg(help_behavior_hint="")] = None
    """Standard deviations of the prior (default: 1 1 0.1745)."""
    all: Annotated[bool, arg(help_behavior_hint="")] = False
    """Join any number of maps; those that do not hang together with the first are left out."""
    bend: Annotated[Literal["auto", "always", "never"], arg(help_behavior_hint="")] = "auto"
    """Bend the second map onto the first: where only that joins them, or always; never: draw it rigid."""
    scale: Annotated[bool, arg(help_behavior_hint="")] = False
    """The second map's scale may be wrong by up to a fifth."""
    explain: Annotated[Path | None, arg(metavar="FILE.png", help_behavior_hint="")] = None
    """Draw the answer and its rivals side by side, also where it is refused."""
    method: Annotated[Method, arg(help_behavior_hint="")] = "joint"
    """Only joint, ours, says how sure it is; the others are there to compare."""
    format: Annotated[Literal["text", "json"], arg(help_behavior_hint="")] = "text"
    """What is printed on stdout; in JSON all angles are rad."""


def run(options: Options) -> None:
    """Read, align, tell, write."""
    check(options)
    submaps = read(options)
    join = join_all if options.all else join_two
    join(options, submaps, maps.settings_for(submaps, options.method, options.scale))


def check(options: Options) -> None:
    """See that the options make sense together. Raises `InputError`."""
    count = len(options.maps)
    if count < 2:
        raise InputError(f"expected two maps, NAME.yaml each, got {count}")
    if count > 2 and not options.all:
        raise InputError(f"expected two maps, got {count}: with --all any number of them is joined")
    for path in options.maps:
        if path.suffix.lower() in IMAGE_SUFFIXES:
            raise InputError(f"{path}: is an image, expected the map's yaml")
    if options.prior_sigma and not options.prior:
        raise InputError("--prior-sigma is for a --prior: there is none")
    if options.prior and options.all:
        raise InputError("--prior is for two maps, not for --all")
    if options.all and options.method != "joint":
        raise InputError(f"--all needs covariances: expected --method joint, got {options.method}")
    for name, used in (
        ("bend", options.bend != "auto"),
        ("scale", options.scale),
        ("explain", options.explain is not None),
    ):
        if used and (options.all or options.method != "joint"):
            raise InputError(f"--{name} is for two maps and --method joint")
    if options.explain is not None and options.explain.suffix != ".png":
        raise InputError(f"--explain {options.explain}: expected the name of a picture, as in why.png")
    if options.prior and abs(options.prior[2]) > 2.0 * math.pi:
        raise InputError(f"--prior: a yaw of {options.prior[2]:g} is more than a turn, expected radians")
    if options.prior_sigma and min(options.prior_sigma) <= 0.0:
        sigmas = " ".join(f"{sigma:g}" for sigma in options.prior_sigma)
        raise InputError(f"--prior-sigma: expected three standard deviations > 0, got {sigmas}")
    if options.out:
        maps.check_output(options.out)


def read(options: Options) -> list[Submap]:
    """The maps as submaps. Raises `InputError`."""
    try:
        read_maps = [maps.read_submap(path) for path in options.maps]
        submaps = [submap for submap, _ in read_maps]
        maps.check_size(submaps, maps.settings_for(submaps, options.method))
        if options.out:
            maps.check_inputs(options.out, options.maps)
    except FormatError as error:
        raise InputError(str(error)) from error
    for note in chain.from_iterable(notes for _, notes in read_maps):
        print(f"{COMMAND}: {note}", file=sys.stderr)
    return submaps


def join_two(options: Options, submaps: list[Submap], settings: AlignConfig) -> None:
    """Stitch the second map to the first. Raises `RefusedError` where that is not sure."""
    a, b = submaps
    found = align(a, b, prior(options, a, b), settings)
    if options.bend == "always" and isinstance(found, Stitch) and found.bend is None:
        from stitch.alignment.tolerant import bend_stitch

        found = bend_stitch(a, b, found, settings)
    elif options.bend == "never" and isinstance(found, Stitch):
        found = replace(found, bend=None)
    if options.explain is not None:
        maps.write_picture(options.explain, explain.draw(labels(options.maps), a, b, found))
    result = maps.between_maps(a, b, found)
    if isinstance(result, NoStitch):
        if options.format == "json":
            print(json.dumps(as_json(result), indent=2))
        best = "" if result.best is None else f"; the best candidate was {in_words(result.best.T_a_b)}"
        raise RefusedError(f"not sure: {result.reason}{best}")
    lines: Sequence[Array] = ()
    drawn = submaps
    if isinstance(found, Stitch) and (found.bend is not None or found.scale != 1.0):
        drawn = [a, replace(b, grid=merge.bent(b.grid, found))]
        lines = found.bend.lines() if found.bend is not None else ()
    written = write(options, [0, 1], drawn, np.array([np.zeros(3), result.T_a_b]), lines)
    if options.format == "json":
        print(json.dumps(as_json(result), indent=2))
    else:
        print(as_text(result, *map(str, options.maps)), *written, sep="\n")


def join_all(options: Options, submaps: list[Submap], settings: AlignConfig) -> None:
    """Stitch every pair and optimise the graph. Raises `RefusedError` where none joins the first map."""
    from stitch.command import map_graph

    names = [str(path) for path in options.maps]
    of_anchors = map_graph.join(len(submaps), lambda a, b: align(submaps[a], submaps[b], None, settings))
    graph, members = map_graph.graph_between_maps(submaps, of_anchors), of_anchors.members
    written = write(options, members, submaps, graph.poses) if len(members) > 1 else []
    if options.format == "json":
        print(json.dumps(map_graph.graph_json(graph, names), indent=2))
    else:
        map_graph.pairs_table(graph, names).print()
    if len(members) < 2:
        raise RefusedError(f"not sure: no map could be joined to {names[0]}")
    if options.format == "text":
        places = [f"{names[k]}: {in_words(T)}" for k, T in zip(members, graph.poses, strict=True)]
        print(f"In the frame of {names[0]}:", *places, *written, sep="\n")
    for k in sorted(set(range(len(names))) - set(members)):
        print(f"{COMMAND}: {names[k]} is left out: it does not hang together with the first", file=sys.stderr)


def prior(options: Options, a: Submap, b: Submap) -> Prior | None:
    """What the user knows, between the submaps' anchors."""
    if options.prior is None:
        return None
    return maps.prior_between(a, b, np.array(options.prior), np.array(options.prior_sigma or PRIOR_SIGMA))


def write(
    options: Options,
    members: Sequence[int],
    submaps: list[Submap],
    poses: Array,
    lines: Sequence[Array] = (),
) -> list[Path]:
    """Write the merged map and its picture, if asked for, and return the files.

    ``poses (M, 3)`` are those of the maps ``members`` in the frame of the first map; ``lines``, each
    ``(n, 2)`` m from the anchor of the first, are drawn across the picture.
    """
    if options.out is None:
        return []
    grids = [submaps[k].grid for k in members]
    T_map_anchor = submaps[0].anchor
    T_first = [
        se2.between(T_map_anchor, se2.compose(T, submaps[k].anchor))
        for k, T in zip(members, poses, strict=True)
    ]
    resolution = min(grid.resolution for grid in grids)
    try:
        onto = merge.canvas(grids, T_first, resolution)
    except ValueError as error:
        raise InputError(str(error)) from error
    whole = merge.merge([merge.place(grid, T, onto) for grid, T in zip(grids, T_first, strict=True)])
    picture = merge.draw(labels([options.maps[k] for k in members]), grids, T_first, resolution, lines)
    corner = se2.transform(T_map_anchor, whole.origin[None])[0]
    return maps.write_map(options.out, replace(whole, origin=corner), T_map_anchor[2], picture)


def labels(maps: Sequence[Path]) -> list[str]:
    """Names for a legend: short where they differ."""
    stems = [path.stem for path in maps]
    return stems if len(set(stems)) == len(stems) else [str(path.with_suffix("")) for path in maps]


if __name__ == "__main__":
    sys.exit(main(Options, COMMAND, run))

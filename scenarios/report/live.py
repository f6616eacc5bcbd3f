"""What the live map shows of a run, as plain JSON: the drive, the world and every method's answer."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from scenarios.evaluation.maps import map_at
from scenarios.evaluation.segmentation import segment_gaps, step_deviations, stitch_error
from scenarios.evaluation.trajectory import aligned
from scenarios.report.method_attributes import colour_indices, merges_in_sequence
from scenarios.report.stitches import RESOLUTION, AlignedPair, AxisSpectra, state_of
from scenarios.report.trajectory_figures import covariance_of, to_map_axes
from sim.record import SimulatedRun
from slam import se2
from slam.mapping import keyframes
from slam.mapping.occupancy import Grid
from slam.odometry.track import Track
from slam.recording import Recording
from slam.se2 import Array
from stitch.alignment.result import Stitch
from stitch.mapping.estimate import Estimate, LoopCandidate

Content = dict[str, object]
Kind = Literal["f4", "i2", "u2", "u1"]
GAPS: dict[str, int] = {"i2": -32768, "u2": 65535, "u1": 255}
"""What stands for "nothing" where a type has no NaN."""
MAX_SCANS = 4000
"""Of a longer drive every second, third … scan is shown: the page shall open at once."""
RANGE_UNIT, ANGLE_UNIT, WALL_UNIT, POINT_UNIT = 0.005, 1e-4, 0.005, 0.01
"""What ranges [m], tilts [rad], true walls [m] and the points of submaps [m] are rounded to."""
UNKNOWN, FREE, WALL = 0, 128, 255
"""Shades of a map's image, which the page's script turns into the colours of its theme."""
FIELD_RESOLUTION = 0.1
"""Side of a pixel of smoke and uneven ground [m]."""
CELL = 0.1
"""Side of a cell [m]; a beam fits when a wall was seen in its cell or one of the eight around it."""
MEMORY = 20
"""Keyframes that are remembered: as many as the front end's local map has."""
PERIOD = 2048
"""Cells after which the plane repeats: 205 m, more than any laser here reaches."""
_NEIGHBOURS = np.indices((3, 3)).reshape(2, 9) - 1


def live_content(
    recording: Recording, estimates: Sequence[Estimate], best: str | None, simulated: SimulatedRun | None
) -> Content:
    """The run as plain JSON; ``best`` is the method that is shown first."""
    rows = shown_rows(recording)
    colours = colour_indices([estimate.method for estimate in estimates])
    return {
        "drive": drive_content(recording, rows, simulated),
        "world": _world_content(simulated),
        "methods": [
            {
                **_method_content(recording, rows, estimate),
                "colour": colour,
                "stitches": [stitch_entry(estimate, stitch, recording.truth) for stitch in estimate.stitches],
            }
            for estimate, colour in zip(estimates, colours, strict=True)
        ],
        "best": best,
    }


def script_safe(content: object) -> str:
    """JSON that cannot end the script element it stands in, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def shown_rows(recording: Recording) -> np.ndarray:
    """Rows ``(M,)`` of the scans that the page shows: all, or evenly spread ones of a long drive."""
    return np.arange(0, len(recording), -(-len(recording) // MAX_SCANS))


def drive_content(recording: Recording, rows: np.ndarray, simulated: SimulatedRun | None) -> Content:
    """The drive as recorded: stamps, beams, tilt (the true one where a simulator knows it) and truth of the
    scans shown."""
    ranges = np.where(has_return(recording), recording.ranges, np.nan)[rows]
    tilt = recording.attitude if simulated is None else simulated.tilt
    source = "as the inertial sensor says" if simulated is None else "the true one"
    return {
        "scans": len(recording),
        "rows": pack(rows),
        "time": pack(recording.time[rows] - recording.time[0]),
        "angles": pack(recording.angles),
        "mount": [round(float(x), 6) for x in recording.laser.T_robot_laser],
        "ranges": pack(ranges, "u2", RANGE_UNIT),
        "truth": None if recording.truth is None else pack(recording.truth[rows]),
        "tilt": None if tilt is None else {"source": source, "angles": pack(tilt[rows], "i2", ANGLE_UNIT)},
        "height": None if simulated is None else simulated.setup.scanner.height,
    }


def map_image(grid: Grid) -> Content:
    """A map: which cells are walls and which are free."""
    shades = np.where(grid.occupied, WALL, np.where(grid.free, FREE, UNKNOWN)).astype(np.uint8)
    return _image(shades, grid.origin, grid.resolution)


def _world_content(simulated: SimulatedRun | None) -> Content:
    """The true walls at the laser's height, smoke and uneven ground; None for what is unknown or absent."""
    if simulated is None:
        return {"walls": None, "smoke": None, "terrain": None}
    terrain, smoke = simulated.setup.world.terrain, simulated.setup.world.smoke
    return {
        "walls": pack(simulated.walls, "i2", WALL_UNIT) if len(simulated.walls) else None,
        "smoke": None if smoke is None else _field(smoke.extinction, smoke.origin, smoke.resolution),
        "terrain": _field(np.abs(terrain.heights), terrain.origin, terrain.resolution),
    }


def _field(values: Array, origin: tuple[float, float], resolution: float) -> Content | None:
    """A field over nodes, brightest where it is highest; None where it is zero everywhere."""
    top = float(values.max(initial=0.0))
    if top <= 0.0:
        return None
    step = max(1, round(FIELD_RESOLUTION / resolution))
    corner = np.asarray(origin) - 0.5 * resolution * step
    shades = np.rint(255.0 * np.sqrt(np.clip(values[::step, ::step] / top, 0.0, 1.0))).astype(np.uint8)
    return {**_image(shades, corner, resolution * step), "top": top}


def _method_content(recording: Recording, rows: np.ndarray, estimate: Estimate) -> Content:
    """A method's answer but its stitches: path, map, submaps, and what its front end says of every scan."""
    poses, track = aligned(estimate.poses, recording.truth), estimate.track
    return {
        "name": estimate.method,
        "poses": pack(poses[rows]),
        "map": _map(recording, poses),
        "fits": pack_bits(fitting_beams(recording, estimate.poses, rows)),
        "track": None if track is None else _track(track, recording.truth, rows),
        "spread": _covariances(estimate, poses, rows),
        "submaps": [
            {
                "start": submap.start,
                "stop": submap.stop,
                "pose": _rounded(poses[submap.start]),
                "points": pack(submap.grid.occupied_points(), "i2", POINT_UNIT),
            }
            for submap in estimate.submaps
        ],
        "contradictions": _contradictions(estimate, poses),
        "cuts": [[int(first), int(last)] for first, last in segment_gaps(estimate.submaps)],
    }


def _contradictions(estimate: Estimate, poses: Array) -> list[Content]:
    """Where the map contradicts itself, in the page's frame, in which the method's poses are ``poses``."""
    if estimate.consistency is None:
        return []
    T_page_map = se2.compose(poses[0], se2.inverse(estimate.poses[0]))
    return [
        {
            "place": _rounded(se2.transform(T_page_map, np.array([[place.x, place.y]]))[0]),
            "scans": list(place.scans),
            "reason": place.reason,
        }
        for place in estimate.consistency.places
    ]


def _map(recording: Recording, poses: Array) -> Content | None:
    """The map, None where the method lost itself so far that no image holds it."""
    try:
        return map_image(map_at(recording, poses))
    except ValueError:
        return None


def _track(track: Track, truth: Array | None, rows: np.ndarray) -> Content:
    """Verdict, matches and confidence of every scan, and the true error of its step [m]."""
    x, y, _ = step_deviations(track, truth)[rows].T
    return {
        "verdict": pack(track.verdict[rows], "u1"),
        "matches": pack(track.matches[rows], "u2"),
        "measures": {name: pack(column[rows]) for name, column in track.confidence.items()},
        "error": None if truth is None else pack(np.hypot(x, y)),
    }


def _covariances(estimate: Estimate, poses: Array, rows: np.ndarray) -> Content | None:
    """Covariance xx, xy, yy [m²] of every position in the page's axes, and what it is of."""
    stated = covariance_of(estimate)
    if stated is None:
        return None
    P = to_map_axes(poses[rows], stated[0][rows])
    what = {"pose": "of the pose", "step": "of the step from the scan it was matched to"}[stated[1]]
    return {"what": what, "values": pack(np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], -1))}


def fitting_beams(recording: Recording, poses: Array, rows: np.ndarray) -> np.ndarray:
    """Which beams of the scans ``rows (M,)`` end at a wall that the last keyframes saw, ``(M, B)`` bool.
    Scans lie at ``poses (N, 3)``. What a method's matcher paired is not recorded; this is the same test for
    all of them."""
    cells, seen = _cells(recording, poses)
    kept = set(keyframes.choose(poses).tolist())
    wanted = {int(row): i for i, row in enumerate(rows)}
    last_seen = np.full((PERIOD, PERIOD), -MEMORY - 1, dtype=np.int32)
    fits = np.zeros((len(rows), cells.shape[1]), dtype=bool)
    number = 0
    for k in sorted(kept | set(wanted)):
        x, y = cells[k, seen[k]].T
        if k in wanted:
            fits[wanted[k], seen[k]] = last_seen[x, y] >= number - MEMORY
        if k in kept:
            last_seen[(x[:, None] + _NEIGHBOURS[0]) % PERIOD, (y[:, None] + _NEIGHBOURS[1]) % PERIOD] = number
            number += 1
    return fits


def has_return(recording: Recording) -> np.ndarray:
    """Which beams ``(N, B)`` have a return within the laser's limits."""
    laser = recording.laser
    return (recording.ranges >= laser.range_min) & (recording.ranges < laser.range_max)


def _cells(recording: Recording, poses: Array) -> tuple[np.ndarray, np.ndarray]:
    """Cells ``(N, B, 2)`` that the beams end in, and which beams ``(N, B)`` have a return."""
    seen = has_return(recording)
    T = se2.compose(poses, recording.laser.T_robot_laser)
    bearing = T[:, 2:] + recording.angles
    r = np.where(seen, recording.ranges, 0.0)
    ends = T[:, None, :2] + np.stack([r * np.cos(bearing), r * np.sin(bearing)], -1)
    return np.floor(ends / CELL).astype(np.int64) % PERIOD, seen


def stitch_entry(estimate: Estimate, stitch: LoopCandidate, truth: Array | None) -> Content:
    """A stitch that a method tried, with the evidence for it and with its error against ``truth (N, 3)``."""
    pair, prior, result = AlignedPair.of(estimate, stitch), stitch.prior, stitch.result
    error = None if truth is None else stitch_error(estimate, stitch, truth)
    entry: Content = {
        "a": stitch.a,
        "b": stitch.b,
        "merges": merges_in_sequence(estimate.method),
        "state": state_of(stitch, error is not None and error.false),
        "reason": None if isinstance(result, Stitch) else result.reason,
        "weight": stitch.weight,
        "prior": None if prior is None else [*_rounded(prior.T_a_b), *_sigmas(prior.covariance)],
        "before": _rounded(pair.before),
        "T": None if pair.T_a_b is None else _rounded(pair.T_a_b),
        "error": None if error is None else [error.translation, float(np.degrees(error.rotation))],
    }
    if isinstance(result, Stitch):
        entry |= {
            "belief": result.belief,
            "score": result.score,
            "overlap": result.overlap_area,
            "agreement": result.agreement,
            "sigma": None if result.covariance is None else _sigmas(result.covariance),
            "rivals": [[*_rounded(other.T_a_b), round(other.score, 3)] for other in result.alternatives[:5]],
        }
    if pair.complete:
        entry["evidence"] = {
            "spectra": [_pack_share(walls.spectrum) for walls in (pair.a, pair.b)],
            "correlation": _pack_share(pair.rotation_correlation()),
            "axes": [_axis(axis) for axis in pair.axis_spectra()],
            "surface": None if (surface := pair.score_surface()) is None else _surface(surface),
        }
    return entry


def _surface(surface: tuple[Array, Array]) -> Content:
    score, first = surface
    low, top = float(np.median(score)), float(score.max())
    return {
        "first": _rounded(first),
        "step": RESOLUTION,
        "width": score.shape[1],
        "values": _pack_share(np.clip((score - low) / max(top - low, 1e-9), 0.0, 1.0)),
    }


def _axis(axis: AxisSpectra) -> Content:
    (first_a, a), (first_b, b), (first, correlation) = axis.a, axis.b, axis.correlation
    share = correlation / max(float(correlation.max()), 1.0)
    return {
        "a": [round(first_a, 3), pack(a, "u2")],
        "b": [round(first_b, 3), pack(b, "u2")],
        "correlation": [round(first, 3), _pack_share(share)],
        "shift": round(axis.shift, 3),
    }


def pack(values: ArrayLike, kind: Kind = "f4", scale: float = 1.0) -> Content:
    """Numbers as multiples of ``scale`` in the type ``kind``, little-endian in base64, clipped to its range.
    NaN and infinities become "nothing" (`GAPS`; in ``f4`` they stay what they are)."""
    array = np.asarray(values, dtype=np.float64)
    if kind in GAPS:
        limits = np.iinfo(kind)
        low, high = (limits.min + 1, limits.max) if kind == "i2" else (limits.min, limits.max - 1)
        whole = np.clip(np.rint(np.where(np.isfinite(array), array / scale, 0.0)), low, high)
        array = np.where(np.isfinite(array), whole, GAPS[kind])
    data = np.ascontiguousarray(array, dtype=f"<{kind}").tobytes()
    return {"kind": kind, "scale": scale, "data": base64.b64encode(data).decode("ascii")}


def _pack_share(values: Array) -> Content:
    """Numbers from 0 to 1 in a byte each."""
    return pack(values, "u1", 1 / 254)


def pack_bits(flags: np.ndarray) -> Content:
    """Flags ``(M, B)`` bool as bits: each row starts a byte, the first flag is its highest bit."""
    data = np.packbits(flags, axis=1)
    encoded = base64.b64encode(data.tobytes()).decode("ascii")
    return {"kind": "u1", "row": int(data.shape[1]), "data": encoded}


def data_address(png: bytes) -> str:
    """A PNG file as the address of an image."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _image(shades: np.ndarray, origin: Array, resolution: float) -> Content:
    """Grey values ``(H, W)`` uint8 with row 0 at the bottom, and the corners of their place [m]."""
    import cv2

    ok, data = cv2.imencode(".png", shades[::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not ok:
        raise RuntimeError(f"OpenCV cannot encode an image of {shades.shape}")
    x, y = (round(float(value), 4) for value in origin)
    height, width = shades.shape
    corners = [x, y, round(x + width * resolution, 4), round(y + height * resolution, 4)]
    return {"image": data_address(data.tobytes()), "corners": corners}


def _rounded(values: ArrayLike) -> list[float]:
    """Numbers to five decimals."""
    return [round(float(value), 5) for value in np.asarray(values)]


def _sigmas(covariance: Array) -> list[float]:
    return _rounded(np.sqrt(np.diag(covariance)))

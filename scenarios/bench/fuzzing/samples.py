"""One small good file of every format that is read, and what reads it."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from slam.formats import FORMATS, carmen, g2o, load, peer, relations, ros_map, square, tum
from slam.formats.answer import read as read_answer
from slam.formats.packed import ZSTD
from slam.graph.pose_graph import PoseGraph
from slam.mapping.occupancy import Grid
from slam.recording import Laser, Odometry, Recording, Relations
from slam.trajectory import Trajectory

SCANS, BEAMS = 4, 12
FLASER = "FLASER 180 {} {} 0 0.1 {} 0 0.1 {} host {}\n"


@dataclass(frozen=True)
class Sample:
    """A format's ``files`` by their name; ``entry`` is the one that a user names, or nothing for the folder;
    ``read`` raises `FormatError` or `InputError`."""

    files: dict[str, bytes]
    entry: str
    read: Callable[[Path], object]


def samples(folder: Path) -> dict[str, Sample]:
    """Every kind of file by its name; those of optional packages where these are installed."""
    drive = recording()
    made = {}
    for name, form in FORMATS.items():
        if form.write is not None and (name != "rosbag" or find_spec("rosbags")):
            form.write(folder / name, drive)
            made[name] = _sample(folder / name, load)
    if "rosbag" in made:
        FORMATS["rosbag"].write(folder / "mcap", drive, "mcap")  # type: ignore[misc, call-arg]
        made["rosbag, mcap"] = _sample(folder / "mcap", load)
        made["rosbag, ROS 1"] = _sample(_as_ros1(folder / "rosbag"), load)
    log = "".join(FLASER.format("1.5 " * 180, k, k, k, k) for k in range(SCANS))
    raw = made["carmen"].files["carmen"].decode().replace("ROBOTLASER1", "RLASER")
    made["carmen, FLASER"] = Sample({"a.log": log.encode()}, "a.log", load)
    made["carmen, others"] = Sample({"a.log": (log + raw).encode()}, "a.log", load)
    zstd = import_module(ZSTD)
    for packing, compress in {"gz": gzip, "bz2": bz2, "xz": lzma, "zst": zstd}.items():
        content = compress.compress(log.encode())
        made[f"log.{packing}"] = Sample({f"a.log.{packing}": content}, f"a.log.{packing}", load)
    return made | _others(folder)


def recording() -> Recording:
    """A drive of a few metres, with everything that a recording can hold."""
    rng = np.random.default_rng(0)
    poses = np.stack([0.3 * np.arange(SCANS), np.zeros(SCANS), 0.1 * np.arange(SCANS)], -1)
    time = 1.0 + np.arange(SCANS)
    return Recording(
        name="fuzz",
        time=time,
        ranges=rng.uniform(1.0, 5.0, (SCANS, BEAMS)),
        angles=np.linspace(-1.5, 1.5, BEAMS),
        laser=Laser(),
        dead_reckoning=poses,
        odometry=Odometry(np.repeat(time, 2), np.repeat(poses, 2, axis=0), 2 * np.arange(SCANS)),
        truth=poses + 0.01,
        relations=Relations(np.array([[1.0, 2.0]]), np.array([[0.3, 0.0, 0.1]])),
    )


def _sample(path: Path, read: Callable[[Path], object]) -> Sample:
    """Of a file, or of a folder's files."""
    if path.is_file():
        return Sample({path.name: path.read_bytes()}, path.name, read)
    return Sample({part.name: part.read_bytes() for part in sorted(path.iterdir())}, "", read)


def _as_ros1(bag: Path) -> Path:
    """A bag's messages as ROS 1 keeps them, in a file beside it."""
    from rosbags.convert import convert
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)  # knows no tf2_msgs
    types.register(
        get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
    )
    file = bag.with_suffix(".bag")
    convert([bag], file, "", 0, None, "", None, types, (), (), (), ())
    return file


def _others(folder: Path) -> dict[str, Sample]:
    """What is no recording: maps, graphs, trajectories, relations, settings, metrics."""
    from PIL import Image

    drive = recording()
    cells = np.random.default_rng(1).uniform(size=(20, 30)) > 0.7
    (folder / "map").mkdir()
    ros_map.write(folder / "map" / "a.yaml", Grid(cells, ~cells, np.zeros(2), 0.05))
    pgm = _sample(folder / "map", ros_map.read).files
    Image.open(folder / "map" / "a.pgm").save(folder / "a.png")
    png = {"a.yaml": pgm["a.yaml"].replace(b"pgm", b"png"), "a.png": (folder / "a.png").read_bytes()}
    k = np.arange(3)
    graph = PoseGraph(
        drive.dead_reckoning,
        np.stack([k, k + 1], -1),
        np.tile([0.3, 0.0, 0.1], (3, 1)),
        np.tile(np.eye(3), (3, 1, 1)),
    ).with_loops(np.array([[0, 3]]), np.array([[0.9, 0.0, 0.3]]), np.eye(3)[None])
    g2o.write(folder / "a.g2o", graph)
    edges = [line for line in (folder / "a.g2o").read_bytes().splitlines(keepends=True) if b"EDGE" in line]
    tum.write(folder / "a.tum", drive.time, drive.dead_reckoning)
    doubt = np.tile(1e-4 * np.eye(3), (len(drive), 1, 1))
    tum.write(folder / "b.tum", drive.time, drive.dead_reckoning, doubt)
    square.write(folder / "a.square", Trajectory(drive.time, drive.dead_reckoning, doubt), "fuzz", "1")
    np.savez(folder / "poses.npz", time=drive.time, poses=drive.dead_reckoning, covariance=doubt)
    carmen.write(folder / "a.log", drive)
    relations.write(folder / "a.relations", Relations(np.array([[1.0, 2.0]] * 3), np.ones((3, 3))))
    answer = "".join(f"{k} {x} {y} {yaw}\n" for k, (x, y, yaw) in enumerate(drive.dead_reckoning))
    return {
        "ROS map, pgm": Sample(pgm, "a.yaml", ros_map.read),
        "ROS map, png": Sample(png, "a.yaml", ros_map.read),
        "g2o": _sample(folder / "a.g2o", _optimise),
        "g2o, edges": Sample({"a.g2o": b"".join(edges)}, "a.g2o", _optimise),
        "tum": _sample(folder / "a.tum", tum.read),
        "relations": _sample(folder / "a.relations", relations.read),
        "tum with covariances": _sample(folder / "b.tum", read_answer),
        "square": _sample(folder / "a.square", read_answer),
        "poses npz": _sample(folder / "poses.npz", read_answer),
        "corrected log": _sample(folder / "a.log", read_answer),
        "peer": Sample({"a.txt": answer.encode()}, "a.txt", lambda path: peer.read(path, SCANS)),
        "settings": Sample({"config.json": _settings().encode()}, "config.json", _read_settings),
        "metrics": Sample({"metrics.json": _metrics().encode()}, "", _read_metrics),
    }


def _optimise(path: Path) -> object:
    from scenarios.posegraph import solve

    return solve(path)


def _settings() -> str:
    from scenarios.jsonable import jsonable
    from scenarios.methods.config import MethodConfig

    return json.dumps({"methods": jsonable(MethodConfig(), words=True)}, indent=1)


def _read_settings(path: Path) -> object:
    from scenarios.methods.config import MethodConfig
    from slam.settings import read_settings

    return read_settings(path, MethodConfig(), under="methods")


def _metrics() -> str:
    row = {
        "metric": "ate_rmse",
        "value": 0.1,
        "unit": "m",
        "better": "lower",
        "method": "ins",
        "reason": None,
    }
    return json.dumps({"schema": 1, "recording": "fuzz", "seed": 0, "metrics": [row] * 3}, indent=1)


def _read_metrics(folder: Path) -> object:
    from scenarios.run_folder.read import read_metrics

    return read_metrics(folder)

"""The files of a bag, and the messages in them; ROS 1 and ROS 2 look alike from here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from slam.formats.rosbag.names import OLD_TF_TYPE, TF_TYPE
from slam.formats.text import File, FormatError

HOW_TO_INSTALL = "a ROS bag needs the package rosbags: pip install 'slamstitch[ros]'"
MAX_NESTING = 50
"""Brackets of a metadata.yaml that may be left open."""
ROS1, METADATA = ".bag", "metadata.yaml"
SUFFIXES = (".db3", ".mcap", ROS1)


def recognise(file: File) -> bool:
    """Whether it is a folder with a bag's files in it, or a file that is named as one."""
    path = file.path
    return bool(_files(path)) if path.is_dir() else path.suffix in SUFFIXES and path.is_file()


def _files(path: Path) -> list[Path]:
    """What rosbags opens of a bag, in this order: its folder, or the files that a folder without a
    metadata.yaml holds, as a recording that was cut off leaves them."""
    if not path.is_dir() or (path / METADATA).is_file():
        return [path]
    found = [file for file in path.iterdir() if file.suffix in SUFFIXES]
    return sorted(found, key=lambda file: (len(file.name), file.name))


def topics(path: Path) -> list[tuple[str, str]]:
    """Name and message type of every topic that has messages, by name. Raises `FormatError`."""
    count: Counter[tuple[str, str]] = Counter()
    for file in _files(path):
        with _reader(file) as (reader, _):
            for connection in reader.connections:
                if not (isinstance(connection.topic, str) and isinstance(connection.msgtype, str)):
                    raise FormatError(f"not a readable bag: a topic is called {connection.topic!r}", file)
                count[connection.topic, connection.msgtype] += connection.msgcount
    return sorted(topic for topic, messages in count.items() if messages)


def messages(path: Path, wanted: Collection[str]) -> Iterator[tuple[str, Any]]:
    """Topic and content of every message on the topics ``wanted``, as logged. Raises `FormatError`."""
    for file in _files(path):
        with _reader(file) as (reader, deserialise):
            chosen = [c for c in reader.connections if c.topic in wanted]
            for connection, _, data in reader.messages(chosen) if chosen else ():
                yield connection.topic, deserialise(data, connection.msgtype)


@contextmanager
def _reader(file: Path) -> Iterator[tuple[Any, Any]]:
    """An open reader of rosbags, and what makes messages of its bytes."""
    ros = rosbags(file)
    _check_nesting(file)
    is_ros1 = file.suffix == ROS1
    title = "ROS 1 bag" if is_ros1 else "ROS 2 bag"
    try:
        with (ros.rosbag1 if is_ros1 else ros.rosbag2).Reader(file) as reader:
            types = typestore(reader.connections if is_ros1 else None)
            yield reader, types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
    except FormatError:
        raise
    except Exception as error:  # rosbags lets through whatever its storage engines and parsers raise
        repair = f"rosbag reindex {file.name}" if is_ros1 else f"ros2 bag reindex {file.name}"
        raise FormatError(f"not a readable {title}: {error}; try {repair}", file) from error


def _check_nesting(bag: Path) -> None:
    """See that a bag's metadata is not nested so deeply that YAML takes seconds. Raises `FormatError`."""
    metadata = bag / METADATA
    if not metadata.is_file():
        return
    text = metadata.read_bytes()
    depth = max(text.count(mark) - text.count(end) for mark, end in ((b"[", b"]"), (b"{", b"}")))
    if depth > MAX_NESTING or b"- " * MAX_NESTING in text:
        raise FormatError(f"{METADATA} is nested too deeply; try ros2 bag reindex {bag.name}", bag)


def rosbags(path: Path) -> Any:
    """The package rosbags, with its readers of both. Raises `FormatError` where it is not installed."""
    try:
        import rosbags
        import rosbags.rosbag1
        import rosbags.rosbag2
    except ImportError:
        raise FormatError(HOW_TO_INSTALL, path) from None
    return rosbags


def typestore(connections: Collection[Any] | None = None) -> Any:
    """The types of ROS 2's own messages; of ROS 1's and of what its bag itself defines, given its
    ``connections``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if connections is None:
        return get_typestore(Stores.ROS2_HUMBLE)
    types = get_typestore(Stores.ROS1_NOETIC)
    for connection in connections:
        if connection.msgtype in (TF_TYPE, OLD_TF_TYPE) and connection.msgtype not in types.types:
            types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    return types

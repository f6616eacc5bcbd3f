"""Settings read back from JSON and set from the shell: what is taken, and what is refused by name."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from scenarios.jsonable import dump, jsonable
from scenarios.methods.config import MethodConfig
from slam.cli import InputError
from slam.settings import describe, merge, read_settings, set_by_words, take_settings, to_words


@dataclass(frozen=True)
class Wheel:
    """A part."""

    radius: float = 0.1
    """Metres."""
    spokes: int = 8
    """How many there are,
    all of one length."""
    load: tuple[float, float] = (1.0, 2.0)
    """Newtons, left and right."""

    def __post_init__(self) -> None:
        if self.radius <= 0.0:
            raise ValueError(f"radius: expected more than 0, got {self.radius}")
        if self.spokes * self.radius > 100.0:
            raise ValueError("the spokes are too many for the radius")


@dataclass(frozen=True)
class Robot:
    """The tree."""

    wheel: Wheel = field(default_factory=Wheel)
    """Its wheel."""
    name: str = "robot"
    """What it is called."""
    drive: Literal["belt", "chain"] = "belt"
    """What drives it."""
    lamp: bool = False
    """Whether there is one."""
    limit: float | None = None
    """Metres per second, or none."""
    gears: tuple[float, ...] = (1.0, 2.0)
    """Ratios."""
    stops: tuple[tuple[float, int], ...] = ((0.5, 1),)
    """Metres, and seconds."""


@dataclass(frozen=True)
class Garage:
    """What is set on the shell: keys begin with the name of a group."""

    robot: Robot = field(default_factory=Robot)
    """In the front."""
    spare_wheel: Wheel = field(default_factory=Wheel)
    """Behind."""


def written(path: Path, content: object) -> Path:
    file = path / "config.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


# From a file


@pytest.mark.parametrize(
    "content",
    [
        {"wheel": {"radius": 0.3}, "lamp": True},
        {"command": "…", "robot": {"wheel": {"radius": 0.3}, "lamp": True}, "seed": 3},
    ],
)
def test_a_part_of_the_tree_leaves_the_rest_as_it_is(content: object, tmp_path: Path) -> None:
    """It may be the tree itself, or lie under a key of a run's config.json."""
    robot = read_settings(written(tmp_path, content), Robot(name="rover"), under="robot")
    assert robot == Robot(Wheel(radius=0.3), name="rover", lamp=True)


def test_every_kind_of_value_is_read() -> None:
    values = {
        "wheel": {"radius": 1, "spokes": 3, "load": [3, -4.5]},
        "name": "rover",
        "drive": "chain",
        "limit": "inf",
        "gears": [1, 2.5, 3],
        "stops": [[1, 2], [0.25, 4]],
    }
    robot = merge(Robot(limit=1.0), values)
    stops = ((1.0, 2), (0.25, 4))
    assert robot == Robot(Wheel(1.0, 3, (3.0, -4.5)), "rover", "chain", False, np.inf, (1.0, 2.5, 3.0), stops)
    assert [type(robot.wheel.radius), type(robot.wheel.load[0]), type(robot.stops[0][1])] == [
        float,
        float,
        int,
    ]
    assert merge(robot, {"limit": None}).limit is None
    assert merge(robot, {"limit": "-inf"}).limit == -np.inf


WRONG = {
    '{"nmae": "x"}': "unknown key 'nmae': did you mean 'name'?",
    '{"wheel": {"raduis": 1}}': "unknown key 'wheel.raduis': did you mean 'radius'?",
    '{"wheel": {"colour": 1}}': "unknown key 'wheel.colour': expected one of radius, spokes, load",
    '{"wheel": 3}': "wheel: expected an object, got 3",
    '{"robot": [1]}': "robot: expected an object of settings, got list",
    '{"wheel": {"radius": "big"}}': "wheel.radius: expected a number, got 'big'",
    '{"wheel": {"radius": true}}': "wheel.radius: expected a number, got True",
    '{"wheel": {"radius": null}}': "wheel.radius: expected a number, got None",
    '{"wheel": {"radius": "nan"}}': "wheel.radius: expected a number, got nan",
    '{"wheel": {"radius": NaN}}': "wheel.radius: expected a number, got nan",
    '{"wheel": {"spokes": 8.5}}': "wheel.spokes: expected a whole number, got 8.5",
    '{"wheel": {"spokes": "inf"}}': "wheel.spokes: expected a whole number, got 'inf'",
    '{"wheel": {"spokes": true}}': "wheel.spokes: expected a whole number, got True",
    '{"lamp": 1}': "lamp: expected true or false, got 1",
    '{"name": 3}': "name: expected a word, got 3",
    '{"drive": "gears"}': "drive: expected one of belt, chain, got 'gears'",
    '{"limit": "fast"}': "limit: expected a number, got 'fast'",
    '{"wheel": {"load": [1]}}': "wheel.load: expected 2 values, got 1",
    '{"wheel": {"load": [1, "x"]}}': "wheel.load: expected a number, got 'x'",
    '{"gears": []}': "gears: expected at least one value",
    '{"gears": [1, null]}': "gears: expected a number, got None",
    '{"stops": [[0.5, 1], [0.5]]}': "stops: expected 2 values, got 1",
    '{"stops": [[0.5, 1.5]]}': "stops: expected a whole number, got 1.5",
    '{"wheel": {"radius": -1}}': "wheel.radius: expected more than 0, got -1.0",
    '{"wheel": {"spokes": 2000}}': "wheel: the spokes are too many for the radius",
    '{"wheel": ': "not JSON",
    "[1, 2]": "expected an object of settings, got list",
}


@pytest.mark.parametrize("content", WRONG)
def test_what_cannot_be_used_is_named_with_the_file(content: str, tmp_path: Path) -> None:
    file = written(tmp_path, content)
    with pytest.raises(InputError) as refused:
        read_settings(file, Robot(), under="robot")
    assert str(refused.value).startswith(f"{file}: {WRONG[content]}")


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "no.json", "No such file"), (tmp_path, "Is a directory")):
        with pytest.raises(InputError, match=rf"{path}: {reason}.*, expected a JSON file of settings"):
            read_settings(path, Robot())
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not JSON"):
        read_settings(tmp_path / "binary", Robot())


def test_the_settings_of_the_methods_are_read_back_to_the_last_bit(tmp_path: Path) -> None:
    dump(tmp_path / "config.json", {"command": "…", "methods": MethodConfig()})
    read = read_settings(tmp_path / "config.json", MethodConfig(), under="methods")
    assert read == MethodConfig()
    assert jsonable(read, words=True) == jsonable(MethodConfig(), words=True)


# From the shell


def on_the_shell(line: str) -> tuple[Garage, list[str]]:
    settings, others = take_settings(line.split(), Garage())
    return set_by_words(Garage(), settings), others


@pytest.mark.parametrize(
    ("line", "robot"),
    [
        ("--robot.wheel.radius 2", Robot(Wheel(radius=2.0))),
        ("--robot.wheel.radius=2", Robot(Wheel(radius=2.0))),
        ("--robot.wheel.radius 1 --robot.wheel.radius 2", Robot(Wheel(radius=2.0))),
        ("--robot.wheel.load -0.5 -1e-3", Robot(Wheel(load=(-0.5, -1e-3)))),
        ("--robot.wheel.load=-0.5 inf", Robot(Wheel(load=(-0.5, np.inf)))),
        ("--robot.wheel.load [3,4]", Robot(Wheel(load=(3.0, 4.0)))),
        ("--robot.gears 3", Robot(gears=(3.0,))),
        ("--robot.gears 3 2 1", Robot(gears=(3.0, 2.0, 1.0))),
        ("--robot.stops 1 2 0.25 4", Robot(stops=((1.0, 2), (0.25, 4)))),
        ("--robot.stops [[1,2],[0.25,4]]", Robot(stops=((1.0, 2), (0.25, 4)))),
        ("--robot.limit inf", Robot(limit=np.inf)),
        ("--robot.limit 3 --robot.limit None", Robot()),
        ("--robot.lamp True", Robot(lamp=True)),
        ("--robot.lamp true", Robot(lamp=True)),
        ("--robot.drive chain --robot.name rover", Robot(name="rover", drive="chain")),
    ],
)
def test_fields_are_set_wherever_they_stand(line: str, robot: Robot) -> None:
    """Before, between or after the other words, which stay in their order."""
    for words in (f"{line} --out DIR log.txt", f"--out DIR {line} log.txt", f"--out DIR log.txt {line}"):
        assert on_the_shell(words) == (Garage(robot), ["--out", "DIR", "log.txt"])


def test_a_dash_in_a_key_is_as_good_as_its_underscore() -> None:
    assert on_the_shell("--spare-wheel.spokes 4")[0] == Garage(spare_wheel=Wheel(spokes=4))


def test_a_field_takes_as_many_words_as_its_type_has_numbers() -> None:
    assert on_the_shell("--robot.wheel.radius 2 3") == (Garage(Robot(Wheel(radius=2.0))), ["3"])
    assert on_the_shell("--robot.wheel.load 2 3 4")[1] == ["4"]


def test_options_with_a_dot_in_their_value_are_none_of_the_settings() -> None:
    words = ["--out=./runs", "a.log", "--mount", "-0.5", "--config", "robot.wheel.json"]
    assert take_settings(words, Garage()) == ({}, words)


def test_settings_that_only_go_together_are_set_together() -> None:
    tree = Wheel(radius=10.0, spokes=8)
    assert set_by_words(tree, {"spokes": ["80"], "radius": ["1"]}) == Wheel(1.0, 80)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("--robot.wheel.radus 2", "unknown setting --robot.wheel.radus: did you mean 'robot.wheel.radius'?"),
        ("--robt.wheel.radius 2", "unknown setting --robt.wheel.radius: did you mean 'robot'?"),
        ("--robot.name.first x", "unknown setting --robot.name.first: did you mean 'robot.name'?"),
        ("--robot.wheel 2", "--robot.wheel: expected a single setting, as --robot.wheel.radius"),
        ("--robot.wheel.radius", "--robot.wheel.radius: expected a value"),
        ("--robot.wheel.radius --out DIR", "--robot.wheel.radius: expected a value"),
        ("--robot.wheel.radius big", "--robot.wheel.radius: expected a number, got 'big'"),
        ("--robot.wheel.radius -1", "--robot.wheel.radius: expected more than 0, got -1.0"),
        ("--robot.wheel.load 1 log.txt", "--robot.wheel.load: expected 2 values, got 1"),
        ("--robot.stops 1 2 3", "--robot.stops: expected 2 values, got 1"),
        ("--robot.gears []", "--robot.gears: expected at least one value"),
        ("--robot.drive gears", "--robot.drive: expected one of belt, chain, got 'gears'"),
    ],
)
def test_what_cannot_be_set_is_named(line: str, complaint: str) -> None:
    with pytest.raises(InputError) as refused:
        on_the_shell(line)
    assert str(refused.value) == complaint


def test_two_values_for_one_are_refused() -> None:
    with pytest.raises(InputError, match=r"^--robot\.name: expected one value, got 2$"):
        set_by_words(Garage(), {"robot.name": ["a", "b"]})


# All of them


def test_a_description_has_key_value_and_meaning() -> None:
    rows = describe(Garage())
    assert rows[0] == ("robot.wheel.radius", 0.1, "Metres.")
    assert rows[1] == ("robot.wheel.spokes", 8, "How many there are, all of one length.")
    assert [key for key, _, _ in rows][-3:] == [
        "spare_wheel.radius",
        "spare_wheel.spokes",
        "spare_wheel.load",
    ]


def test_every_setting_of_the_methods_says_what_it_means() -> None:
    assert [key for key, _, meaning in describe(MethodConfig()) if not meaning] == []


def test_every_setting_of_the_methods_can_be_set_to_what_is_printed_of_it() -> None:
    changed = merge(MethodConfig(), {"slam": {"segmentation": {"threshold": 3.5, "release": 1.25}}})
    rows = [(f"--{key}", *to_words(value), "--out", "DIR") for key, value, _ in describe(changed)]
    settings, others = take_settings([word for row in rows for word in row], MethodConfig())
    assert set_by_words(MethodConfig(), settings) == changed
    assert set(others) == {"--out", "DIR"}

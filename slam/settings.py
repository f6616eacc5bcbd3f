"""A tree of frozen data classes as settings: read back from JSON, or set one by one from the shell."""

from __future__ import annotations

import json
import math
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from slam.cli import InputError, nearest

Tree = TypeVar("Tree")


def read_settings(path: Path, defaults: Tree, under: str = "") -> Tree:
    """``defaults`` with what a JSON file says instead, which may be a part of the tree.

    ``under`` names the key that holds the tree where the file is a run's ``config.json``. Raises `InputError`
    naming the file, the key and what was expected.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}, expected a JSON file of settings") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected an object of settings, got {type(content).__name__}")
    if not isinstance(part := content.get(under, content), dict):
        raise InputError(f"{path}: {under}: expected an object of settings, got {type(part).__name__}")
    try:
        return merge(defaults, part)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def merge(defaults: Tree, values: object, key: str = "") -> Tree:
    """A data class with some of its fields, and of its fields' fields, as the mapping ``values`` has them.

    Raises ``ValueError`` naming the dotted key.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"{key or 'settings'}: expected an object, got {values!r}")
    hints = get_type_hints(type(defaults))
    changed = {}
    for name, value in values.items():
        dotted = f"{key}.{name}".lstrip(".")
        if name not in hints:
            raise ValueError(f"unknown key {dotted!r}: {nearest(name, hints)}")
        current = getattr(defaults, name)
        changed[name] = (
            merge(current, value, dotted) if is_dataclass(current) else convert(hints[name], value, dotted)
        )
    try:
        return replace(defaults, **changed)  # type: ignore[type-var]
    except ValueError as error:
        named = str(error).partition(":")[0] in hints  # the data class's own check names the field
        raise ValueError(f"{key}{'.' if named else ': '}{error}".lstrip(".: ")) from error


def set_by_words(defaults: Tree, settings: Mapping[str, Sequence[str]]) -> Tree:
    """A tree with fields set as on the shell: dotted key → words. Raises `InputError` naming the key."""
    values: dict[str, Any] = {}
    for dotted, words in settings.items():
        group, (*above, name) = values, dotted.split(".")
        for part in above:
            group = group.setdefault(part, {})
        group[name] = _value_of(words, _hint_of(defaults, dotted), dotted)
    try:
        return merge(defaults, values)
    except ValueError as error:
        raise InputError(f"--{error}") from error


def to_words(value: object) -> list[str]:
    """A setting's value as words of the shell, which `set_by_words` reads back."""
    if isinstance(value, tuple):
        return [word for part in value for word in to_words(part)]
    return [value if isinstance(value, str) else json.dumps(value).replace("Infinity", "inf")]


def take_settings(words: Sequence[str], tree: object) -> tuple[dict[str, list[str]], list[str]]:
    """The words of a command line that set fields of ``tree`` (``--slam.loops.length 4``), by dotted key, and
    the other words. A key takes as many words as its type has numbers."""
    settings: dict[str, list[str]] = {}
    others: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        key, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or "." not in key:
            others.append(word)
            continue
        key = key.replace("-", "_")
        taken = [value] if equals else []
        most = _words_of(_hint_of(tree, key))
        if rest and not taken and not rest[0].startswith("--"):
            taken.append(rest.pop(0))
        while taken and rest and len(taken) < most and _is_number(rest[0]):
            taken.append(rest.pop(0))
        if not taken:
            raise InputError(f"--{key}: expected a value")
        settings[key] = taken
    return settings, others


def describe(tree: object, key: str = "") -> list[tuple[str, object, str]]:
    """Every setting of a tree: dotted key, value, and what its docstring line says."""
    rows: list[tuple[str, object, str]] = []
    docs = _field_docs(type(tree))
    for f in fields(tree):  # type: ignore[arg-type]
        value, dotted = getattr(tree, f.name), f"{key}.{f.name}".lstrip(".")
        rows += describe(value, dotted) if is_dataclass(value) else [(dotted, value, docs.get(f.name, ""))]
    return rows


def convert(hint: Any, value: object, key: str) -> Any:
    """A JSON value as the type of a field. Raises ``ValueError`` naming the key and what was expected."""
    origin, options = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in options:
            return None
        return convert(next(o for o in options if o is not type(None)), value, key)
    if origin is Literal:
        if value in options:
            return value
        raise ValueError(f"{key}: expected one of {', '.join(map(str, options))}, got {value!r}")
    if origin is tuple:
        return _convert_tuple(options, value, key)
    if hint is float and isinstance(value, str) and value in ("nan", "inf", "-inf"):
        value = float(value)  # as JSON, which has no such numbers, is given them
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        if math.isnan(value):
            raise ValueError(f"{key}: expected a number, got nan")
        return float(value)
    if isinstance(value, hint) and not (hint is int and isinstance(value, bool)):
        return value
    expected = {float: "a number", int: "a whole number", bool: "true or false", str: "a word"}[hint]
    raise ValueError(f"{key}: expected {expected}, got {value!r}")


def _convert_tuple(options: tuple[Any, ...], value: object, key: str) -> tuple[Any, ...]:
    values = list(value) if isinstance(value, list | tuple) else [value]
    if not values:
        raise ValueError(f"{key}: expected at least one value")
    if options[-1] is Ellipsis:
        if get_origin(options[0]) is tuple and values and not isinstance(values[0], list | tuple):
            size = len(get_args(options[0]))  # flat, as on the shell
            values = [values[k : k + size] for k in range(0, len(values), size)]
        return tuple(convert(options[0], v, key) for v in values)
    if len(values) != len(options):
        raise ValueError(f"{key}: expected {len(options)} values, got {len(values)}")
    return tuple(convert(o, v, key) for o, v in zip(options, values, strict=True))


def json_value(word: str) -> object:
    """A word of the shell as JSON has it, or the word itself."""
    try:
        return json.loads(word)
    except ValueError:
        return None if word == "None" else {"True": True, "False": False}.get(word, word)


def _value_of(words: Sequence[str], hint: Any, key: str) -> object:
    """The words given for a field as JSON has them: a list for a tuple, which may be one word too."""
    values = [json_value(word) for word in words]
    if get_origin(hint) is tuple and not isinstance(values[0], list):
        return values
    if len(values) != 1:
        raise InputError(f"--{key}: expected one value, got {len(values)}")
    return values[0]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _words_of(hint: Any) -> int:
    """How many words of the shell a field takes at most."""
    options = get_args(hint)
    if get_origin(hint) is not tuple:
        return 1
    return 10_000 if options[-1] is Ellipsis else len(options)


def _hint_of(tree: Any, dotted: str) -> Any:
    """Type of the field with a dotted key. Raises `InputError` with the nearest name."""
    node, names = tree, dotted.split(".")
    for k, name in enumerate(names):
        hints = get_type_hints(type(node)) if is_dataclass(node) else {}
        if name not in hints:
            known = [".".join([*names[:k], known]) for known in hints] or [".".join(names[:k])]
            raise InputError(f"unknown setting --{dotted}: {nearest('.'.join(names[: k + 1]), known)}")
        node, hint = getattr(node, name), hints[name]
    if is_dataclass(node):
        raise InputError(f"--{dotted}: expected a single setting, as --{dotted}.{fields(node)[0].name}")
    return hint


def _field_docs(kind: type) -> dict[str, str]:
    """The docstring line beneath each field of a data class."""
    import ast
    import inspect
    import textwrap

    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0].body  # type: ignore[attr-defined]
    return {
        field.target.id: " ".join(doc.value.value.split())
        for field, doc in pairwise(body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(doc, ast.Expr)
        and isinstance(doc.value, ast.Constant)
        and isinstance(doc.value.value, str)
    }

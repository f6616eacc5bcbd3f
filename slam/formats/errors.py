"""Bad input, told in one line."""

from __future__ import annotations

from os import PathLike


class FormatError(ValueError):
    """A file that cannot be read: ``path:line: what was wrong, what was expected``, in one line.

    ``line`` counts from 1 and is None where the whole file is meant.
    """

    def __init__(
        self, message: str, path: str | PathLike[str] | None = None, line: int | None = None
    ) -> None:
        self.path = path
        self.line = line
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + " ".join(message.split()))

"""Options that commands share."""

from __future__ import annotations

import pytest

from scenarios.options import check_seed, parse_names, parse_seeds
from slam.cli import InputError


def test_names_are_known_and_each_is_taken_once() -> None:
    assert parse_names("b, a,b", ["a", "b"], "method") == ["b", "a"]
    with pytest.raises(InputError, match="--methods: expected one or more of a"):
        parse_names(" ,", ["a"], "method")
    with pytest.raises(InputError, match="--variant: expected one or more of a"):
        parse_names("", ["a"], "variant", "--variant")
    with pytest.raises(InputError, match="unknown method 'wsn': did you mean 'wsm'"):
        parse_names("wsn", ["icp", "wsm"], "method")


def test_seeds_are_a_range_a_list_or_a_count() -> None:
    assert parse_seeds("3-5") == parse_seeds("3-5", count=True) == [3, 4, 5]
    assert parse_seeds("7,9") == parse_seeds("7,9", count=True) == [7, 9]
    assert parse_seeds("7") == [7]
    assert parse_seeds("3", count=True) == [0, 1, 2]
    with pytest.raises(InputError, match="at least one"):
        parse_seeds("0", count=True)


@pytest.mark.parametrize("text", ["", "5-3", "a", "1,,2", "-1", "1-2-3"])
def test_what_are_no_seeds_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected first-last or numbers with commas between"):
        parse_seeds(text)


def test_a_seed_is_not_negative() -> None:
    check_seed(0)
    with pytest.raises(InputError, match="--seed: expected 0 or more, got -1"):
        check_seed(-1)

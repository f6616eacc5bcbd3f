"""One table, four forms."""

from __future__ import annotations

import pytest

from slam.table import Bold, Table, number, with_interval

TABLE = Table(
    ("method", "x [m] ↓"),
    [("a_b", Bold("0.10")), ("a_b", "–"), ("c|d", "2.00")],
    title="50 % & more",
    notes=("seeds 0–3",),
)


def test_columns_make_the_cells_of_a_record() -> None:
    columns = (("name", lambda one: one[0]), ("twice", lambda one: str(2 * one[1])))
    made = Table.of([("a", 1), ("b", 2)], columns, "title", notes=("note",))
    assert (made.columns, made.rows) == (["name", "twice"], [["a", "2"], ["b", "4"]])
    assert (made.title, made.names, made.notes) == ("title", 1, ("note",))


def test_console_aligns_numbers_right_and_cuts_nothing() -> None:
    lines = TABLE.console().splitlines()
    assert lines[0].strip() == "50 % & more"
    assert [line.split() for line in lines[-4:-1]] == [["a_b", "0.10"], ["a_b", "–"], ["c|d", "2.00"]]
    assert len({len(line.rstrip()) for line in lines[-4:-1]}) == 1
    assert lines[-1] == "seeds 0–3"
    wide = Table(("n",), [("9" * 500,)]).console()
    assert "9" * 500 in wide
    assert "\x1b[1m" in TABLE.console(styled=True)
    assert "\x1b" not in TABLE.console()


def test_markdown_escapes_and_marks_the_best() -> None:
    assert TABLE.markdown().splitlines() == [
        "50 % & more", "", "| method | x [m] ↓ |".replace("[m]", r"\[m\]"), "|---|---:|",
        r"| a\_b | **0.10** |", r"| a\_b | – |", r"| c\|d | 2.00 |", "", "seeds 0–3",
    ]  # fmt: skip


def test_latex_escapes_and_draws_rules() -> None:
    lines = TABLE.grouped().latex().splitlines()
    assert lines[1] == r"\caption{50 \% \& more}"
    assert lines[2] == r"\begin{tabular}{lr}"
    assert lines[4] == r"method & x [m] $\downarrow$ \\"
    assert lines[6:10] == [r"a\_b & \textbf{0.10} \\", r" & -- \\", r"\midrule", r"c|d & 2.00 \\"]


def test_html_escapes() -> None:
    page = TABLE.html()
    assert "<caption>50 % &amp; more</caption>" in page
    assert '<td>a_b</td><td class="number"><b>0.10</b></td>' in page


def test_grouped_says_a_name_once_and_draws_a_rule_where_it_changes() -> None:
    grouped = TABLE.grouped()
    assert [row[0] for row in grouped.rows] == ["a_b", "", "c|d"]
    assert grouped.sections == {1}


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 2 cells in a row, got 1"):
        Table(("a", "b"), [("1",)])


def test_numbers_that_are_none() -> None:
    assert (number(None), number(float("nan")), number(0.12345)) == ("–", "–", "0.123")
    assert with_interval(0.5, 0.25, 0.75) == "0.50 [0.25, 0.75]"
    assert with_interval(0.5, float("nan"), float("nan")) == "0.50"

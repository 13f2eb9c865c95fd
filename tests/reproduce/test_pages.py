"""Tables of the paper: how numbers, intervals, notes and lists are written, and what they cost."""

from __future__ import annotations

import pytest

from latentmotion.evaluation.report import UNITS_OF_TABLES
from latentmotion.reproduce.budget import BUDGETS, MODELS, PAPER, SMALL
from latentmotion.reproduce.markdown import (
    MINUTES,
    RowResult,
    TableResult,
    cell,
    markdown,
    minutes,
    number,
    overview,
    rows_of,
)
from latentmotion.reproduce.table import TABLES, Row, Table, rows_named

ROWS = (
    Row("real", "Real", "real", paper={"FID": 0.002, "R@1": 0.511}),
    Row("one", "One", model="mld_1"),
    Row("two", "Two", model="mld_7", paper={"FID": 0.473, "R@1": None}),
    Row("none", "None", missing="its code was never published"),
)
TABLE = Table("t", "A table", "table 1", ROWS, ("FID", "R@1", "AITS"), expects="less noise.")


def page(*rows: RowResult, table: Table = TABLE) -> str:
    return markdown(table, TableResult("t", "small", "set 123", "clean", rows), "half of all")


def lines_of(text: str) -> list[list[str]]:
    return [
        [part.strip() for part in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|")
    ]


# Numbers


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (0.47312, "0.473"),
        (0.9996, "1.000"),
        (1.0, "1.00"),
        (-3.14159, "-3.14"),
        (9.999, "10.00"),
        (10.0, "10.0"),
        (54.44, "54.4"),
        (100.0, "100"),
        (-1234.5, "-1234"),
    ],
)
def test_numbers_have_three_digits(value: float, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize("value", [0.0123, 0.5, 4.56, 33.3, 512.0])
def test_a_number_like_another_has_its_decimals(value: float) -> None:
    for other in (0.2, 2.0, 20.0, 200.0):
        decimals = len(number(other).partition(".")[2])
        assert len(number(value, like=other).partition(".")[2]) == decimals
        assert abs(float(number(value, like=other)) - value) <= 0.5 * 10**-decimals


@pytest.mark.parametrize(
    ("figure", "text"),
    [
        ([0.4731, 0.01249], "0.473 ± 0.012"),
        ([54.4, 0.26], "54.4 ± 0.3"),
        ([123.4, 7.5], "123 ± 8"),
        ([54.4, 0.04], "54.4"),  # an interval that would read 0
        ([0.25, None], "0.250"),
        ([0.25, 0.0], "0.250"),
        ([None, None], "–"),
    ],
)
def test_means_stand_with_their_interval(figure: list[float | None], text: str) -> None:
    assert cell(figure) == text


# Pages


def test_columns_are_those_that_somebody_measured() -> None:
    result = RowResult("one", "", {"FID": [0.5, 0.01], "Odd": [1.0, None]})
    head, rule, *rows = lines_of(page(result))
    assert head == ["", f"FID {UNITS_OF_TABLES['FID']}".strip(), "FID, paper", "R@1, paper"]
    assert rule == ["---"] * 4
    assert rows == [
        ["Real", "–", "0.002", "0.511"],
        ["One", "0.500 ± 0.010", "·", "·"],
        ["Two", "–", "0.473", "?"],
    ]


def test_rows_keep_the_order_of_the_table() -> None:
    results = [RowResult(name, "", {"AITS": [value, None]}) for name, value in
               (("two", 2.0), ("one", 1.0))]  # fmt: skip
    table = lines_of(page(*results))
    assert [row[0] for row in table[2:]] == ["Real", "One", "Two"]
    assert table[0][-1] == "AITS s ↓" and [row[-1] for row in table[2:]] == ["–", "1.00", "2.00"]
    assert page(*results) == page(*reversed(results))


def test_a_page_says_where_its_figures_are_from() -> None:
    text = page()
    assert text.startswith("### A table\n") and "The paper finds: less noise." in text
    for part in ("Paper: table 1.", "Here: set 123, budget small", "Protocol clean.",
                 "Budget small: half of all."):  # fmt: skip
        assert part in text
    assert "None: not run, its code was never published." in text
    silent = Table("t", "A table", "table 1", ROWS[:1], ("FID",))
    assert "The paper finds" not in page(table=silent) and "not run" not in page(table=silent)


def test_notes_stand_once_and_warnings_with_their_rows() -> None:
    results = [
        RowResult(name, "", notes=("few motions", "half steps"), warnings=("NaN",))
        for name in ("one", "two")
    ]
    text = page(*results)
    for note in ("* Few motions.", "* Half steps.", "* Warning for one, two: NaN"):
        assert text.count(note) == 1
    assert text.index("Few motions") < text.index("Half steps") < text.index("Warning")


# Lists


def test_models_of_several_rows_are_trained_once() -> None:
    row = Row("a", "A", model="mld_1")
    one = MINUTES["vae"] + MINUTES["denoiser"]
    assert minutes([row]) == minutes([row, Row("b", "B", model="mld_1", steps=5)]) == one
    assert minutes([Row("a", "A", "reconstructed", "mld_1")]) == MINUTES["vae"]
    assert minutes([Row("a", "A", "prior", "mld_1"), row]) == one
    assert minutes([Row("real", "Real", "real")]) == minutes([]) == 0


def test_minutes_of_all_tables_are_no_more_than_those_of_each() -> None:
    each = [minutes(table.rows) for table in TABLES.values()]
    together = minutes(row for table in TABLES.values() for row in table.rows)
    assert max(each) <= together <= sum(each)
    raw = next(model for model in MODELS.values() if model.raw and not model.shipped)
    assert minutes([Row("r", "R", model=raw.name)]) == MINUTES["raw"]


def test_a_line_tells_what_can_be_run() -> None:
    line = overview([TABLE]).splitlines()[1]
    assert line.split()[:3] == ["t", "3", str(minutes(ROWS))]
    assert line.endswith("A table: table 1")
    text = rows_of(TABLE)
    assert "none              None (not run here: its code was never published)" in text
    assert "metrics: FID, R@1, AITS" in text and "data: any text-motion data set" in text


def test_names_find_what_bears_them() -> None:
    for name, table in TABLES.items():
        assert table.name == name
        names = [row.name for row in table.rows]
        assert len(set(names)) == len(names), name
        able = [row for row in table.rows if not row.missing]
        assert list(rows_named(table, [row.name for row in able])) == able
    for name, budget in BUDGETS.items():
        assert budget.name == name
    assert list(BUDGETS.values()) == [PAPER, SMALL]


def test_published_figures_are_possible() -> None:
    rows = [row.paper for table in TABLES.values() for row in table.rows if row.paper]
    unstated = [value for paper in rows for value in paper.values()].count(None)
    assert (sum(map(len, rows)), unstated) == (480, 17)
    for paper in rows:
        figures = {name: value for name, value in paper.items() if value is not None}
        ranks = [figures[f"R@{k}"] for k in (1, 2, 3) if f"R@{k}" in figures]
        assert ranks == sorted(ranks) and all(0 < rank < 1 for rank in ranks)
        assert all(value > 0 for value in figures.values())
        if "PA-MPJPE" in figures:  # alignment only takes error away
            assert figures["PA-MPJPE"] < figures["MPJPE"]
        if "Accuracy" in figures:
            assert figures["Accuracy"] < 1

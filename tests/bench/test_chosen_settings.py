"""The settings of solvers in a stream, chosen by hand-made tables, by a run and by the shipped table."""

import shutil
from collections.abc import Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from command_line import CommandLine
from measured_rows import ladder, row, table
from small_races import Race

from bench.derived.measurements import ONESHOT
from bench.derived.tiers import tier_settings
from bench.messages import columns
from bench.messages.task import RaceError, Tier, settings_ladder, tightest
from bench.races.chosen_settings import ACCURACY, SHIPPED, accuracy, choices, ship, table_of
from bench.races.kind import kinds
from bench.store import Run
from solvers import Lane
from solvers.protocol import setting_text
from solvers.registry import Described, describe, find, from_file

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
TIERS = (Tier.DEFAULT, Tier.LOW, Tier.HIGH, Tier.EXACT)
RUNGS = ({"eps": 1e-4}, {"eps": 1e-8}, {"eps": 1e-12})


def solver(**known: object) -> Described:
    """A solver of three settings, from loose to tight, that has other defaults."""
    return replace(Described("daqp", Lane.DIRECT, "", "", "", True, RUNGS), **known)  # type: ignore[arg-type]


def measured(gaps: list[float], **known: Any) -> pd.DataFrame:
    """The settings for each tier, if the solver's settings have these gaps on a problem."""
    return tier_settings(table(ladder({"p1": gaps}, setting=[setting_text(rung) for rung in RUNGS], **known)))


def chosen(found: pd.DataFrame, solver: Described, tiers: Iterable[Tier]) -> dict[Tier, tuple[int, str]]:
    return {
        tier: (setting.rung, basis)
        for setting, its in choices(solver, tuple(tiers), found, "run").items()
        for tier, basis in its.items()
    }


# By a table.


UNTESTED = {Tier.LOW: (2, "untested"), Tier.HIGH: (2, "untested")}
CHANGED = ({"eps": 1e-3}, {"eps": 1e-8}, {"eps": 1e-14})


@pytest.mark.parametrize(
    ("known", "ladder", "expected"),
    [
        pytest.param(
            {"gaps": [1e-5, 5e-11, 1e-11]},
            RUNGS,
            {
                Tier.DEFAULT: (-1, "default"),
                Tier.LOW: (0, "run"),
                Tier.HIGH: (1, "run"),
                Tier.EXACT: (2, "not reached"),
            },
            id="the one chosen for the tier, and the tightest where it is not reached",
        ),
        pytest.param({"solver": "osqp"}, RUNGS, UNTESTED, id="the table does not know the solver"),
        pytest.param({"lane": "qpsolvers"}, RUNGS, UNTESTED, id="the table does not know the lane"),
        pytest.param({"scaling": "raw"}, RUNGS, UNTESTED, id="the table does not know scaled data"),
        pytest.param(
            {"gaps": [1e-5, 5e-11, 1e-16]},
            CHANGED,
            {
                Tier.DEFAULT: (-1, "default"),
                Tier.LOW: (2, "untested"),
                Tier.HIGH: (1, "run"),
                Tier.EXACT: (2, "untested"),
            },
            id="what a changed ladder still has is kept, and the rest is untested",
        ),
        # The noise of no problem is known.
        pytest.param({}, RUNGS, {Tier.STAGE: (2, "untested")}, id="a tier that was not judged is not out of reach"),
        pytest.param(
            {"noise_um": 0.01, "stage_excess": [1.0, 1e-4, 0.0]},
            RUNGS,
            {Tier.STAGE: (1, "run")},
            id="a tier that was judged",
        ),
    ],
)
def test_each_tier_has_its_chosen_setting_and_the_basis_of_the_choice(
    known: dict[str, Any], ladder: tuple[dict[str, float], ...], expected: dict[Tier, tuple[int, str]]
) -> None:
    assert chosen(measured(**{"gaps": [0.0, 0.0, 0.0], **known}), solver(ladder=ladder), expected) == expected


def test_a_setting_chosen_for_several_tiers_is_raced_once_with_the_basis_of_each() -> None:
    found = choices(solver(defaults=RUNGS[2]), TIERS, measured([1e-2, 1e-2, 5e-11]), "run")
    assert [(setting.rung, basis) for setting, basis in found.items()] == [
        (2, {Tier.DEFAULT: "default", Tier.LOW: "run", Tier.HIGH: "run", Tier.EXACT: "not reached"})
    ]


def test_a_users_file_has_its_tightest_setting_untested(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        'from solvers.direct.osqp import Osqp as Theirs\n\n\nclass Mine(Theirs):\n    name = "mine"\n'
    )
    mine = describe(from_file(tmp_path / "mine.py"))
    ((setting, basis),) = choices(mine, (Tier.LOW, Tier.HIGH), table_of("")[0], "reference").items()
    assert (setting, set(basis.values())) == (tightest(mine), {"untested"})
    assert setting.text == setting_text({**mine.defaults, **find("osqp", "direct").load().ladder(1.0)[-1]})


# By a run.


def test_the_settings_of_a_run_are_those_that_follow_from_its_rows(clean_race: Race) -> None:
    found, name = table_of(str(clean_race.run.path))
    assert name == "clean"
    pd.testing.assert_frame_equal(found, tier_settings(clean_race.rows))


def test_a_run_without_chosen_settings_is_refused_before_anything_is_written(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    shutil.copytree(clean_race.run.path, tmp_path / "unfinished")
    (tmp_path / "unfinished" / "rows.parquet").unlink()
    kinds()["stream"].start(tmp_path, kinds()["stream"].settings(), "stream")
    (tmp_path / "file").write_text("")
    for run, message in (
        ("unfinished", "has no rows.parquet: the run was not finished, so resume it"),
        ("file", "is not a run folder"),
        ("stream", "is a stream race, and this needs the rows of a one-shot race"),
        ("missing", "is not a run folder: it has no run.json"),
    ):
        call = piezobench(
            "race", "--race", "stream", "--settings", run, "--solver", "daqp", "--out", "results", folder=tmp_path
        )
        assert f"{tmp_path / run}" in call.refusal
        assert message in call.refusal
        assert not (tmp_path / "results").exists()


def test_a_run_without_scaled_data_is_refused(clean_race: Race, tmp_path: Path) -> None:
    shutil.copytree(clean_race.run.path, tmp_path / "raw")
    clean_race.rows[clean_race.rows.scaling == "raw"].to_parquet(tmp_path / "raw" / "rows.parquet")
    with pytest.raises(RaceError, match=r"raw: settings are taken from a race in scaled data, and this one has none$"):
        table_of(str(tmp_path / "raw"))


@pytest.mark.slow
def test_a_stream_uses_the_settings_of_the_given_run(piezobench: CommandLine, clean_race: Race, tmp_path: Path) -> None:
    call = piezobench.run(
        "race",
        "--race",
        "stream",
        "--samples",
        200,
        "--lane",
        "direct",
        "--solver",
        "osqp",
        "--solver",
        "piqp",
        "--tier",
        "low",
        "--settings",
        clean_race.run.path,
        "--out",
        tmp_path,
        "--name",
        "stream",
    )
    rows = Run.open(tmp_path / "stream").rows(kinds()["stream"].schema).set_index("solver")
    found = table_of(str(clean_race.run.path))[0].set_index(["scaling", "solver", "lane", "tier"]).setting
    assert (rows.basis["osqp"], rows.setting["osqp"]) == ("clean", found["scaled", "osqp", "direct", "low"])
    assert (rows.basis["piqp"], rows.setting["piqp"]) == ("untested", tightest(describe(find("piqp", "direct"))).text)
    assert "low, untested" in call.stdout


# The shipped rows.


def test_the_shipped_rows_are_those_of_the_reference_run() -> None:
    shipped = columns.read(Path(str(files("bench.races") / SHIPPED)), ACCURACY)
    pd.testing.assert_frame_equal(shipped, accuracy(Run.open(REFERENCE).rows(ONESHOT)))


def test_by_the_shipped_rows_our_exact_solver_reaches_every_tier() -> None:
    found, name = table_of("")
    assert name == "reference"
    known = describe(find("box_active_set", "kernel"))
    expected = dict.fromkeys(set(Tier) - {Tier.DEFAULT}, (settings_ladder(known)[-1].rung, "run"))
    assert chosen(found, known, expected) == expected


def test_the_rows_written_for_shipping_give_the_settings_of_the_run(clean_race: Race, tmp_path: Path) -> None:
    ship(clean_race.run.path, tmp_path / SHIPPED)
    written = columns.read(tmp_path / SHIPPED, ACCURACY)
    assert set(written.scaling) == {"scaled"}
    whole = tier_settings(clean_race.rows)
    pd.testing.assert_frame_equal(tier_settings(written), whole[whole.scaling == "scaled"].reset_index(drop=True))


def test_only_cold_answers_on_scaled_data_are_shipped() -> None:
    rows = table([row(), row(start="warm"), row(scaling="raw"), row(problem="p2")])
    assert accuracy(rows)[["problem", "scaling", "start"]].to_numpy().tolist() == [
        ["p1", "scaled", "cold"],
        ["p2", "scaled", "cold"],
    ]

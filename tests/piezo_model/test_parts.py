"""Parts of a recording: each has a start of its own, and nothing crosses from one into the next."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_models import a_drive, reloaded, structure, true_model
from plain_stage import THRESHOLDS, Vector, stage

from piezo_model import HysteresisCreepModel, ModelError, Recording, identify
from piezo_model.identification import gram_matrix, start
from piezo_model.identification.autocorrelation import autocorrelation_time, independent_samples
from piezo_model.identification.creep import holds


def swelling(cycles: float, samples: int) -> Vector:
    """A sine that swells, so that it erases the states before it slowly."""
    t = np.linspace(0.0, 1.0, samples)
    return np.asarray(5 + 4 * np.sin(2 * np.pi * cycles * t) * (0.1 + 0.9 * t))


def joined(parts: list[tuple[Vector, Vector]], noise: float = 0.1) -> Recording:
    """Parts, each a drive and how far the states before it are away from its first sample, as one recording."""
    u = np.concatenate([drive for drive, _ in parts])
    y = np.concatenate([stage(drive, drive[0] + before) for drive, before in parts])
    y += np.random.default_rng(0).normal(0.0, noise, y.size)
    starts = np.cumsum([0, *(drive.size for drive, _ in parts[:-1])]).tolist()
    return replace(Recording.from_arrays(u, y, 5e-3, input_unit="V", output_unit="um"), starts=tuple(starts))


UP, DOWN = -THRESHOLDS, np.array([0.24, 0.8, 1.1])
"""States after an ascent, and those of a memory curve that no single branch has."""


def test_each_part_begins_in_states_of_its_own_and_the_model_keeps_them(tmp_path: Path) -> None:
    made = joined([(swelling(10.0, 4000), UP), (swelling(7.0, 4000), DOWN)])
    model = identify(made)
    (later,), rms = model.report["parts"], model.report["fit"]["rms"]
    assert rms < 0.12
    assert (later["first_sample"], later["start"]) == (4000, "searched")
    loaded = reloaded(model, tmp_path)
    first, second = (start.play[: model.structure.n + 1] for start in loaded.starts)
    np.testing.assert_array_equal(loaded.starts[0].play, model.start.play)
    assert first.min() < first[0]  # after an ascent
    assert second.max() > second[0]
    simulated = np.sqrt(np.mean((loaded.simulate(made) - made.y) ** 2))
    assert [simulated, loaded.validate(made).fit.rms] == pytest.approx([rms, rms], rel=1e-4)
    assert loaded.validate(made.part(slice(4000, None))).fit.rms < 0.13


def test_many_short_parts_give_the_model_of_a_long_recording_without_a_search_of_their_states() -> None:
    rng = np.random.default_rng(1)
    drives = [5 + rng.uniform(2, 4) * np.sin(np.linspace(0, rng.uniform(9, 15), 30)) for _ in range(60)]
    model = identify(joined([(drive, UP) for drive in drives]), n=5, m=1, creep_rates=())
    starts, slow = [part["start"] for part in model.report["parts"]], swelling(3.0, 3000)
    assert (model.report["start"], len(starts), "searched" in starts) == ("after an ascent", 59, False)
    # after 1500 samples the states before it are forgotten
    assert np.std((model.simulate(slow) - stage(slow, slow[0]))[1500:]) < 0.5


def test_a_part_without_a_counted_output_takes_the_start_of_the_others() -> None:
    made = joined([(swelling(10.0, 3000), UP), (swelling(7.0, 500), UP), (swelling(7.0, 3000), UP)])
    silent = made.uncounted.copy()
    silent[3000:3500] = True
    report = identify(replace(made, uncounted=silent), n=4, m=1).report
    assert (report["fit"]["missing"], len(report["parts"])) == (500, 2)
    assert report["fit"]["rms"] < 0.5


def test_holds_of_a_part_do_not_depend_on_the_others() -> None:
    held = np.concatenate([swelling(3.0, 500), np.full(150, 5.0)])
    made = joined([(drive, UP) for drive in (held, held[::-1].copy(), held)])
    assert [np.unique(holds(made)[part]).tolist() for part in (slice(0, 650), slice(650, 1300))] == [[-1, 0], [-1, 1]]


def test_independent_samples_are_counted_in_each_part_and_no_correlation_crosses_them() -> None:
    white = np.random.default_rng(0).normal(size=4000)
    slow = np.cumsum(white) / 50
    assert independent_samples([slow[:2000], slow[2000:]]) == pytest.approx(
        independent_samples([slow[:2000]]) + independent_samples([slow[2000:]])
    )
    assert autocorrelation_time([np.repeat(white[:80], 50)]) > 30
    assert max(autocorrelation_time([white[:2000], other]) for other in (white[2000:], white[:2000])) < 1.2


@pytest.mark.parametrize("lag", ["estimate", "remove"])
def test_sweeps_below_each_other_do_not_show_a_lag_that_the_sensor_has_not(lag: str) -> None:
    made = joined([(swelling(2.0, 2000), np.zeros(3)), (swelling(8.0, 2000), np.zeros(3))], noise=1e-3)
    report = identify(made, lag=lag).report
    assert (report["lag"]["is_significant"], "lags by" in " ".join(report["findings"])) == (False, False)


def test_a_long_recording_gives_the_model_of_all_of_it_from_a_million_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    made = joined([(swelling(40.0, 12_000), UP)])
    whole = identify(made, n=5, m=1)
    for module in (gram_matrix, start):
        monkeypatch.setattr(module, "GRAM_SAMPLES", 3000)
    monkeypatch.setattr(gram_matrix, "CHUNK", 400)
    thinned = identify(made, n=5, m=1)
    assert (thinned.report["start"], thinned.report["fit"]["samples"]) == (whole.report["start"], made.length)
    assert thinned.report["fit"]["rms"] == pytest.approx(whole.report["fit"]["rms"], rel=0.01)
    np.testing.assert_allclose(thinned.simulate(made.x), whole.simulate(made.x), atol=0.3)


def test_given_states_are_those_of_the_first_part_alone_and_later_ones_begin_where_the_model_errs_least() -> None:
    made = joined([(swelling(10.0, 3000), UP), (swelling(7.0, 3000), DOWN)])
    searched = identify(made, n=5, m=1)
    start = searched.starts[0]
    np.testing.assert_allclose(searched.simulate(made, start), searched.simulate(made), atol=1e-9)
    model = identify(made, n=5, m=1, state=start)
    assert (model.report["start"], model.report["parts"][0]["start"]) == ("given", "searched")
    np.testing.assert_array_equal(model.starts[0].play, start.play)
    assert model.starts[1].play.max() > model.starts[1].play[0]


def test_a_recording_is_that_of_a_model_only_with_its_period_and_its_parts(tmp_path: Path) -> None:
    x = a_drive(4000)
    one = Recording.from_arrays(x, true_model(structure(creep_rates=())).simulate(x), 5e-3)
    two = replace(one, starts=(0, 1700))
    for fitted in (one, two):
        model = identify(fitted, n=2, m=1, creep_rates=())
        model.save(tmp_path / "model.json")
        for recording in (one, two, replace(one, sample_time=0.05), one.part(slice(3999))):
            for same in (model, HysteresisCreepModel.load(tmp_path / "model.json"), replace(model, report={})):
                found = same.validate(recording)
                assert found.own == (recording is fitted)
                assert not found.own or found.fit.rms == pytest.approx(model.report["fit"]["rms"], rel=1e-4)
    path = tmp_path / "model.json"
    path.write_text(path.read_text().replace('"creep"', '"kreep"'))
    with pytest.raises(ModelError, match=r"model\.json: .*creep"):
        HysteresisCreepModel.load(path)


@pytest.mark.parametrize(
    "report", [{"lag": {"removed": True}}, {"recording": [], "parts": 3}, {"left_out_dynamics": 7}]
)
def test_a_report_informs_and_nothing_that_runs_depends_on_it(report: dict[str, object], tmp_path: Path) -> None:
    x = a_drive(3000)
    model = replace(true_model(structure()), report=report)
    loaded = reloaded(model, tmp_path)
    assert loaded.validate(Recording.from_arrays(x, model.simulate(x), 5e-3)).fit.rms_percent < 1.0
    assert loaded.at(1e-3).require_stable(1.0) == np.inf

"""Scoreboard: all programs navigate the same data, rows stay, and each sentence says what it rests on."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import public_sets
import pytest
from sensor_logs import tables, write

from lab import Experiment
from lab.base.files.mission_error import MissionError
from lab.experiment.scoreboard import comparison, results
from lab.experiment.scoreboard.comparison import AWAITED, MISSING, RUN, Row, checked_files, compare, figures
from lab.experiment.scoreboard.opponents import Given, installed, python_ins, sidereon
from lab.experiment.scoreboard.registry import (
    LAB,
    PROGRAMS,
    DataSet,
    Protocol,
    Published,
    data_set,
    data_sets,
)
from lab.experiment.scoreboard.results import describe_standing, kept_rows, merge_rows, of_set, tabulate_rows
from lab.experiment.scoreboard.results import write as keep
from lab.motion.frames.displacement import displacement

ROOT = Path(__file__).parents[2]
SECONDS = 15.0
MADE = DataSet(
    name="made",
    title="a made flight",
    source="here",
    licence="BSD-3-Clause",
    layout="log",
    against="fixes",
    protocol=Protocol("none", turns=3, seconds=SECONDS),
    settings={"sensors": {"gyro": {"bias_sigma": 0.3}, "gps": {"velocity_variance": 0.01}}},
)


@pytest.fixture(scope="module")
def recordings() -> Path:
    named = os.environ.get("INS_LAB_RECORDINGS")
    folder = Path(named) if named else ROOT.parent / "shared" / "recordings"
    if not folder.is_dir():
        pytest.skip("no recordings here: name their folder in INS_LAB_RECORDINGS")
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = public_sets.made(90.0)
    return write(tmp_path_factory.mktemp("sets") / "made", log)


def test_our_row_is_what_the_outage_function_says(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "PROGRAMS", PROGRAMS[:1])
    experiment = Experiment(mission=str(made)).update(MADE.settings)
    errors = experiment.outage(SECONDS).rows[0].errors
    assert errors is not None
    (ours,) = compare(MADE, made, tmp_path)
    assert ours.outages == len(errors.begins) > 2
    assert ours.figures["horizontal_rms_m"] == pytest.approx(
        np.sqrt(np.mean(errors.horizontal[:, -1] ** 2)), rel=1e-6
    )
    assert ours.figures["horizontal_worst_m"] == pytest.approx(errors.horizontal[:, -1].max(), rel=1e-6)
    size = np.sqrt(np.mean(errors.horizontal[:, -1] ** 2 + errors.vertical[:, -1] ** 2))
    assert ours.figures["three_d_rms_m"] == pytest.approx(size, rel=1e-6)


@pytest.mark.proof
def test_python_ins_has_the_same_data_and_finds_the_same_path(made: Path, tmp_path: Path) -> None:
    """Two programs of the same filter, from the same start: their errors after outages differ by a third."""
    about = replace(MADE, protocol=MADE.protocol._replace(turns=1))
    rows = {row.program: row for row in compare(about, made, tmp_path)}
    ours, theirs = rows[LAB], rows["python-ins"]
    assert theirs.outcome == RUN
    assert theirs.outages == ours.outages
    for name in ("horizontal_rms_m", "three_d_rms_m"):
        assert theirs.figures[name] == pytest.approx(ours.figures[name], rel=0.35)
    assert theirs.log_s == ours.log_s
    assert 0 < ours.processor_s < theirs.processor_s


@pytest.mark.proof
def test_an_opponent_with_perfect_sensors_flies_the_truth() -> None:
    """Without fixes, a filter that trusts its sensors follows a flight of turns to a centimetre."""
    experiment = Experiment(mission="montreal")
    experiment.set("trajectory.imu_rate", 50)
    run = experiment.run()
    assert run.ideal is not None
    truth = run.truth_arrays
    assert truth is not None
    given = Given.of(run)
    start = given.start._replace(
        position=truth.position[0], velocity_n=truth.velocity_n[0], q_nb=truth.q_nb[0]
    )
    imu = given.imu._replace(dtheta=run.ideal.dtheta, dvelocity=run.ideal.dvelocity)
    perfect = given._replace(imu=imu, start=start, sigma=1e-3 * given.sigma, noise=1e-8 * given.noise)
    all_but_one = np.arange(given.fixes.time.size) > 0
    programs = {"python-ins": python_ins, "sidereon": sidereon}
    there = {name: program for name, program in programs.items() if installed(name)}
    assert "python-ins" in there
    for program in there.values():
        alone = program(perfect, all_but_one)()
        apart = np.abs(displacement(truth.position, alone.position)).max(axis=0)
        print(program.__name__, apart)
        assert (apart < 0.1).all()


def test_what_is_known_of_sidereon_still_holds() -> None:
    """Its gyro biases are frozen because they diverge at rest; where this fails, they can be estimated."""
    program = pytest.importorskip("sidereon")
    radius, rate, gravity, dt = 6378137.0, 7.292115e-5, 9.7803253359, 0.05
    C_en = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])
    rng = np.random.default_rng(0)
    found = {}
    for sigma in (1e-6, 1e-3):
        P = np.diag(np.repeat([0.1, 0.1, 0.01, 1e-3, sigma], 3) ** 2)
        spec = program.ImuSpec(1e-4, 1e-5, 1e-9, 1e-9, float("inf"), float("inf"))
        nav = program.NavState(0.0, [radius, 0, 0], [0, 0, 0.0], C_en)
        state = program.InsFilterState.from_covariance(nav, program.ErrorStateLayout.FIFTEEN, P)
        engine = program.InertialFilter.with_config(state, program.InertialFilterConfig(spec))
        for step in range(1, 2401):
            engine.propagate(
                program.ImuSample.increment(step * dt, [0, 0, -gravity * dt], [rate * dt, 0, 0], dt)
            )
            if step % 20 == 0:
                place = [radius + rng.normal(0, 0.01), rng.normal(0, 0.01), rng.normal(0, 0.01)]
                velocity = list(rng.normal(0, 0.01, 3))
                engine.update_loose(
                    program.GnssFixMeasurement.position_velocity(
                        step * dt, place, velocity, 1e-4 * np.eye(6), 8
                    )
                )
        found[sigma] = np.abs(engine.state.nominal.gyro_bias_rps).max()
    assert found[1e-6] < 1e-6
    assert found[1e-3] > 5e-3  # five σ and more from the truth, which is zero


def test_a_program_that_is_not_installed_has_a_row_that_says_so(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "installed", lambda program: "")
    found = compare(MADE, made, tmp_path)
    assert [row.outcome for row in found] == [RUN, MISSING, MISSING]
    assert found[1].reason == "pip install python-ins"
    assert found[0].checked == "nothing"
    assert set(found[0].files) == {"imu.csv", "gnss.csv", "ref.csv"}


def test_a_program_that_fails_has_a_row_with_its_reason(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(given: Given, withheld: np.ndarray) -> None:
        raise ArithmeticError("singular")

    monkeypatch.setitem(comparison.OPPONENTS, "python-ins", fails)
    monkeypatch.setattr(comparison, "PROGRAMS", PROGRAMS[:2])
    ours, theirs = compare(MADE, made, tmp_path)
    assert ours.outcome == RUN
    assert (theirs.outcome, theirs.reason) == ("refused", "ArithmeticError: singular")


def test_errors_from_a_reference_are_those_of_the_antenna(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reference of a made flight is the truth at the IMU; the fixes are noisy and 2 m away from it."""
    monkeypatch.setattr(comparison, "PROGRAMS", PROGRAMS[:1])
    arm = (1.0, 0.5, -2.0)
    log = tables(20, 140, lever_arm=arm)
    folder = write(tmp_path / "made", log._replace(imu=log.imu[::2]))
    about = replace(MADE, lever_arm_m=arm, protocol=Protocol("none", turns=3, seconds=2.0))
    found = {
        against: compare(replace(about, against=against), folder, tmp_path / against)[0].figures[
            "three_d_rms_m"
        ]
        for against in ("fixes", "reference")
    }
    # The noise of a fix is 0.5 m an axis; short outages leave less. At the IMU, 2.3 m would be missing.
    assert found["reference"] ** 2 < found["fixes"] ** 2 - 0.5 * 0.75
    assert found["reference"] < 1.0


@pytest.mark.proof
def test_a_whole_run_counts_where_nothing_is_withheld(made: Path, tmp_path: Path) -> None:
    about = replace(MADE, against="reference", protocol=Protocol("none", turns=1))
    found = {row.program: row for row in compare(about, made, tmp_path)}
    result = Experiment(mission=str(made)).update(MADE.settings).run()
    truth = result.truth_arrays
    assert truth is not None
    apart = displacement(truth.position, result.solution_arrays.position)
    ours = found[LAB]
    assert ours.outages == 0
    assert ours.figures["three_d_rms_m"] == pytest.approx(np.sqrt(np.nanmean(np.sum(apart**2, axis=1))))
    assert found["python-ins"].figures["horizontal_rms_m"] == pytest.approx(
        ours.figures["horizontal_rms_m"], rel=0.2
    )


def test_the_figures_are_those_of_a_pencil() -> None:
    found = figures(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, -12.0], [0.0, 1.0, 0.0]]))
    assert found["horizontal_rms_m"] == pytest.approx(np.sqrt(26 / 3))
    assert found["horizontal_median_m"] == 1.0
    assert found["horizontal_worst_m"] == 5.0
    assert found["three_d_rms_m"] == pytest.approx(np.sqrt(170 / 3))
    assert (found["worst_north_m"], found["worst_east_m"], found["worst_down_m"]) == (3.0, 4.0, 12.0)


def test_an_outage_that_does_not_fit_is_refused(made: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no outage of 300 s fits"):
        compare(replace(MADE, protocol=Protocol("none", turns=1, seconds=300.0)), made, tmp_path)


# What is kept.


def test_no_row_of_the_registry_is_missing_and_none_was_removed() -> None:
    """A row that is removed from the file leaves a gap in the numbers, which `kept_rows` refuses."""
    found = kept_rows()
    assert {one.key for one in found} >= {(name, program) for name in data_sets() for program in PROGRAMS}
    assert {one.row.data for one in found} <= data_sets().keys()


def test_the_first_rows_stand_with_their_losses() -> None:
    found = {one.key: one.row for one in kept_rows()}
    for name in ("rtkx_walk", "comma2k19", "vn310_static", "sim_msfs"):
        for program in PROGRAMS:
            row = found[name, program]
            assert row.outcome == RUN
            assert row.version
            assert row.date
            assert row.processor_s > 0
            assert row.settings
            assert row.checked == "registered"
            assert set(row.files) == set(data_set(name).files)
            assert set(row.figures) == set(comparison.STATISTICS)
    sentence, basis = describe_standing(data_set("rtkx_walk"), of_set(kept_rows(), "rtkx_walk"))
    assert "worse than the best of the others, sidereon" in sentence
    assert "2 outages" in basis


@pytest.mark.parametrize("name", ["rtkx_walk", "comma2k19", "vn310_static", "sim_msfs"])
def test_the_kept_rows_are_repeated(recordings: Path, tmp_path: Path, name: str, monkeypatch) -> None:
    monkeypatch.setattr(comparison, "PROGRAMS", PROGRAMS[:1])
    (found,) = compare(data_set(name), recordings / name, tmp_path)
    stood = {one.key: one.row for one in kept_rows()}[name, LAB]
    assert found.outages == stood.outages
    for statistic, value in stood.figures.items():
        assert found.figures[statistic] == pytest.approx(value, rel=0.02, abs=0.01)


def _with(kept: list[results.Kept], row: Row) -> results.Kept:
    return next(one for one in merge_rows(kept, [row]) if one.key == (row.data, row.program))


def test_a_newer_row_replaces_and_keeps_what_it_replaced() -> None:
    first = merge_rows([], [])
    assert [one.number for one in first] == list(range(1, 3 * len(data_sets()) + 1))
    assert {one.row.outcome for one in first} == {AWAITED}
    row = Row("nclt", LAB, RUN, version="1", date="2026-01-01", figures={"horizontal_rms_m": 3.0})
    one = _with(first, row)
    assert (one.row, one.earlier) == (row, ())
    again = row._replace(date="2026-02-01", figures={"horizontal_rms_m": 3.00001})
    assert _with([one], again).earlier == ()
    worse = row._replace(version="2", figures={"horizontal_rms_m": 4.0})
    after = _with([one], worse)
    assert after.number == one.number
    assert after.row.figures["horizontal_rms_m"] == 4.0
    assert [old["figures"]["horizontal_rms_m"] for old in after.earlier] == [3.0]
    # A program that is no longer there takes nothing away.
    assert _with([after], Row("nclt", LAB, MISSING)) == after


def test_a_file_of_results_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    digests, errors = {"imu.csv": "ab" * 32}, figures(np.ones((2, 3)))
    new = [
        Row("nclt", program, RUN, "x", "1", "2026-01-01", 2, errors, 0.5, 90.0, digests, "nothing", "all")
        for program in PROGRAMS
    ]
    keep(path, merge_rows([], new))
    found = kept_rows(path)
    assert [one.row for one in found if one.row.data == "nclt"] == new
    assert results.known_files(found, "nclt") == digests
    content = json.loads(path.read_text("utf-8"))
    del content["rows"][4]
    path.write_text(json.dumps(content), "utf-8")
    with pytest.raises(MissionError, match="was removed or moved"):
        kept_rows(path)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"schema": "x", "schema_version": 1, "rows": []}', "[" * 100_000, '{"rows": [1]}'],
)
def test_another_file_is_no_file_of_results(tmp_path: Path, text: str) -> None:
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(MissionError, match=r"results\.json"):
        kept_rows(path)


def test_a_sentence_says_who_is_ahead_and_what_it_rests_on() -> None:
    published = (Published("Other", "horizontal_rms_m", 2.0, "result", "a paper"),)
    about = replace(MADE, published=published)

    def said(mine: float, theirs: float) -> str:
        found = [
            Row("made", LAB, RUN, outages=6, figures={"horizontal_rms_m": mine}, checked="nothing"),
            Row("made", "python-ins", RUN, outages=6, figures={"horizontal_rms_m": theirs}),
        ]
        sentence, basis = describe_standing(about, found)
        assert "6 outages, from the last withheld fix" in basis
        assert "no SHA-256 of these files was known before" in basis
        return sentence

    assert (
        said(1.0, 3.0) == "INS Lab 1 m is 2.00 × better than the best of the others, Other (published) 2 m."
    )
    assert said(3.0, 1.5) == "INS Lab 3 m is 2.00 × worse than the best of the others, python-ins 1.5 m."
    assert "is even with" in said(1.0, 1.01)
    awaited = [Row("made", LAB, AWAITED)]
    assert describe_standing(about, awaited) == ("No result.", "the data were not at hand")
    titles, lines = tabulate_rows(about, awaited)
    assert {len(line) for line in lines} == {len(titles)}
    assert lines[-1][0] == "Other, published"


# Wrong uses.


def test_files_of_something_else_are_refused_by_their_hash(recordings: Path, tmp_path: Path) -> None:
    folder = tmp_path / "rtkx_walk"
    folder.mkdir()
    for name in ("imu.csv", "gnss.csv", "ref.csv"):
        (folder / name).write_bytes((recordings / "comma2k19" / name).read_bytes())
    with pytest.raises(MissionError, match=r"gnss\.csv: is another file: its SHA-256 begins with 7c891525"):
        checked_files(data_set("rtkx_walk"), folder)
    (folder / "ref.csv").unlink()
    with pytest.raises(MissionError, match=r"ref\.csv is missing; it is published at github"):
        checked_files(data_set("rtkx_walk"), folder)


def test_files_without_a_registered_hash_must_be_those_of_the_first_result(made: Path) -> None:
    found, _ = checked_files(MADE, made)
    with pytest.raises(MissionError, match="is another file"):
        checked_files(MADE, made, {**found, "imu.csv": "0" * 64})


def test_the_registry_is_whole() -> None:
    for about in data_sets().values():
        assert about.source
        assert about.licence
        assert about.protocol.basis
        assert about.against in ("fixes", "reference", "truth")
        assert all(one.statistic in comparison.STATISTICS and one.where for one in about.published)
        assert all(len(digest) == 64 for digest in about.files.values())
        Experiment().update(about.settings)
    with pytest.raises(MissionError, match="accepted: rtkx_walk, comma2k19"):
        data_set("nowhere")

"""``ins-lab profile``, and what an import asks and keeps."""

from __future__ import annotations

import json

import numpy as np
import pytest
from asking import ask, refused
from sensor_logs import tables

from lab.data.files.profile import FOLDER_VARIABLE
from lab.missions.catalogue import OWN_FOLDER_VARIABLE


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the folder of the reader, in which his profiles and missions are, too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "profiles"))
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path / "missions"))
    return tmp_path


def table(path, head: str, rows: np.ndarray) -> None:
    path.write_text("\n".join((head, *(",".join(f"{x:.10g}" for x in row) for row in rows))))


def test_the_profiles_are_listed(folder) -> None:
    answer = ask("profile", "list")
    assert answer.exit_code == 0
    assert "JSBSim csv" in answer.stdout and str(folder / "profiles") in answer.stdout
    found = json.loads(ask("profile", "list", "--json").stdout)
    assert {"name", "file", "of", "columns"} == set(found[0])


def test_what_is_wrong_with_a_profile_has_exit_code_2(folder) -> None:
    (folder / "a.toml").write_text('name = "x"\n[columns]\na = "bread[g]"')
    refused(ask("profile", "check", "a.toml"), "'bread' is no quantity")
    (folder / "a.toml").write_text('name = "x"\n[columns]\na = "force_x[g]"')
    assert "x: 1 column, needs a." in ask("profile", "check", "a.toml").stdout
    (folder / "b.csv").write_text("b,c\n1,2\n")
    refused(ask("profile", "check", "a.toml", "b.csv"), "needs: a; no headings are recognised in it")
    (folder / "b.csv").write_text("t_ms,wx,wy\n" + "".join(f"{k}00,{k},2\n" for k in range(30)))
    refused(ask("profile", "check", "a.toml", "b.csv"), "needs: a; its headings are t_ms, wx, wy")


def test_a_question_without_a_terminal_prints_the_commands_and_an_answer_is_kept(folder) -> None:
    source = tables(30, 90)
    imu = source.imu.copy()
    imu[:, 4:] *= 100.0
    table(folder / "imu.csv", "t,wx,wy,wz,ax,ay,az", imu)
    table(folder / "gps.csv", "t,lat,lon,alt,vn,ve", source.gnss[:, :6])
    asked = ask("import", "imu.csv", "gps.csv", "--as", "log")
    refused(asked, "which may be cm/s² (981) or mg (1000)")
    (command,) = (
        line.strip() for line in asked.stderr.splitlines() if "cm/s²" in line and "ins-lab import" in line
    )
    assert command == (
        "ins-lab import imu.csv gps.csv --as log --unit 'ax=cm/s²' --unit 'ay=cm/s²' --unit 'az=cm/s²'"
    )
    units = [part for axis in "xyz" for part in ("--unit", f"a{axis}=cm/s²")]
    kept = ask("import", "imu.csv", "gps.csv", "--as", "log", *units, "--save-profile", "Desk")
    assert kept.exit_code == 0 and (folder / "profiles" / "desk.toml").is_file()
    again = ask("import", "imu.csv", "gps.csv", "--as", "log")
    assert again.exit_code == 0 and "in cm/s² (as Desk writes)" in again.stdout


def test_columns_are_proposed_with_their_evidence(folder) -> None:
    rest = np.column_stack((np.arange(300) * 20, np.zeros((300, 5)), -np.ones(300)))
    table(folder / "a.csv", "t,gx,gy,gz,ax,ay,az", rest)
    answer = ask("profile", "propose", "a.csv")
    assert answer.exit_code == 0
    assert "az=force_z[g]" in answer.stdout and "guessed: it is 1 g long" in answer.stdout
    found = {one["heading"]: one for one in json.loads(ask("profile", "propose", "a.csv", "--json").stdout)}
    assert (found["t"]["said"], found["t"]["unsure"]) == ("time[ms]", True)
    # What is proposed is accepted as it stands.
    said = [part for one in found.values() for part in ("--column", f"{one['heading']}={one['said']}")]
    refused(ask("import", "a.csv", "--as", "log", *said), "no columns of latitude and longitude")

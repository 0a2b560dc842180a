"""JSBSim's csv: what JSBSim itself writes agrees with its own properties at the same instants."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.formats import read_raw, reader_of
from lab.data.rebuild.raw_flight import RawFlight
from lab.missions import MissionError, mission, prepare_import
from lab.motion.frames.rotation import C_nb_from_euler

jsbsim = pytest.importorskip("jsbsim")

GROUPS = (
    "<rates>ON</rates><velocities>ON</velocities><atmosphere>ON</atmosphere><position>ON</position>"
    "<propulsion>ON</propulsion>"
)
PROPERTIES = "".join(
    f"<property>{path}</property>"
    for path in (
        "position/lat-geod-rad", "position/long-gc-deg", "position/geod-alt-ft", "velocities/v-north-fps",
        "velocities/v-east-fps", "velocities/v-down-fps", "attitude/phi-rad", "attitude/theta-deg",
        "attitude/psi-rad", "velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec",
        "velocities/vt-fps", "aero/alpha-rad", "aero/beta-deg",
    )
)  # fmt: skip
FOOT = 0.3048
TRUTH = {
    "time": ("simulation/sim-time-sec", 1.0),
    "latitude": ("position/lat-geod-rad", 1.0),
    "longitude": ("position/long-gc-rad", 1.0),
    "height": ("position/geod-alt-ft", FOOT),
    "north": ("velocities/v-north-fps", FOOT),
    "east": ("velocities/v-east-fps", FOOT),
    "down": ("velocities/v-down-fps", FOOT),
    "roll": ("attitude/phi-rad", 1.0),
    "pitch": ("attitude/theta-rad", 1.0),
    "yaw": ("attitude/psi-rad", 1.0),
    "p": ("velocities/p-rad_sec", 1.0),
    "q": ("velocities/q-rad_sec", 1.0),
    "r": ("velocities/r-rad_sec", 1.0),
    "airspeed": ("velocities/vt-fps", FOOT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
}


def fly(folder, what: str) -> tuple[RawFlight, dict[str, np.ndarray]]:
    """Fly three seconds of a turn; return the csv as read, and the properties at every step."""
    directive = folder / "output.xml"
    directive.write_text(
        f'<?xml version="1.0"?><output name="{folder / "out.csv"}" type="CSV" rate="120">{what}</output>'
    )
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("c172p")
    fdm.set_output_directive(str(directive))
    for name, value in {
        "ic/h-sl-ft": 6000, "ic/vc-kts": 100, "ic/lat-geod-deg": -43, "ic/long-gc-deg": 172,
        "ic/psi-true-deg": 30, "propulsion/set-running": -1,
    }.items():  # fmt: skip
        fdm[name] = value
    fdm.run_ic()
    fdm["atmosphere/wind-north-fps"] = 20.0
    fdm["fcs/aileron-cmd-norm"] = 0.2
    rows = []
    for _ in range(360):
        rows.append([fdm[path] * factor for path, factor in TRUTH.values()])
        fdm.run()
    return read_raw(folder / "out.csv"), dict(zip(TRUTH, np.array(rows).T, strict=True))


@pytest.mark.parametrize("what", [GROUPS, PROPERTIES], ids=["groups", "properties"])
def test_what_jsbsim_writes_is_what_its_properties_say(tmp_path, capfd, what):
    flight, truth = fly(tmp_path, what)
    # The csv begins with the initial state and holds every step.
    rows = np.searchsorted(truth["time"], flight.time - 1e-6)
    kept = (rows > 2) & (rows < len(truth["time"]))
    assert kept.sum() > 300
    at = {name: value[rows[kept]] for name, value in truth.items()}
    np.testing.assert_allclose(flight.time[kept], at["time"], rtol=0, atol=1e-6)

    def close(value: np.ndarray | None, names: tuple[str, ...], tolerance: float) -> None:
        assert value is not None
        wanted = np.column_stack([at[name] for name in names])
        off = value[kept].reshape(len(wanted), -1) - wanted
        if "yaw" in names:
            off = np.angle(np.exp(1j * off))
        assert np.abs(off).max() < tolerance

    close(flight.latitude, ("latitude",), 1e-9)
    close(flight.longitude, ("longitude",), 1e-9)
    close(flight.height, ("height",), 1e-4)
    close(flight.velocity_n, ("north", "east", "down"), 1e-6)
    close(flight.euler, ("roll", "pitch", "yaw"), 1e-8)
    close(flight.body_rate, ("p", "q", "r"), 1e-8)
    close(flight.airspeed, ("airspeed",), 1e-6)
    close(flight.alpha, ("alpha",), 1e-8)
    close(flight.beta, ("beta",), 1e-8)
    assert np.degrees(at["roll"][-1]) > 10.0


def test_the_acceleration_is_the_change_of_velocity(tmp_path, capfd):
    flight, _ = fly(tmp_path, GROUPS)
    assert flight.velocity_n is not None and flight.euler is not None and flight.acceleration_b is not None
    change = np.gradient(flight.velocity_n, flight.time, axis=0)
    change_b = np.einsum("nji,nj->ni", C_nb_from_euler(flight.euler), change)
    # Up to the Earth's turning under north, v²/R, of 1 mm/s².
    assert np.abs(flight.acceleration_b - change_b)[20:-2].max() < 0.05
    assert np.linalg.norm(flight.acceleration_b[-1]) > 1.0


def test_a_csv_without_position_has_the_velocity(tmp_path, capfd):
    flight, _ = fly(tmp_path, "<rates>ON</rates><velocities>ON</velocities>")
    assert flight.latitude is None
    assert flight.velocity_n is not None


def test_a_csv_of_rates_alone_is_told_what_to_write(tmp_path, capfd):
    with pytest.raises(MissionError, match="<position>ON</position>"):
        fly(tmp_path, "<rates>ON</rates>")


@pytest.mark.parametrize("said", [True, False])
@pytest.mark.parametrize("degrees", [True, False])
def test_the_csv_of_the_first_years_is_read(tmp_path, said, degrees):
    """Headings of 2001: angles in radians without a word, or in degrees with one, or without."""
    flown = mission("montreal").recording
    factor, tail = (180 / np.pi, " (Deg)" if said else "") if degrees else (1.0, "")
    roll, pitch, yaw = factor * flown.euler.T
    columns = {
        "Time": flown.time,
        "P": 0 * roll, "Q": 0 * roll, "R": 0 * roll,
        "QBar": 0 * roll,
        "Vtotal": flown.airspeed / FOOT,
        "UBody": 0 * roll, "VBody": 0 * roll, "WBody": 0 * roll,
        **dict(zip(("Vn", "Ve", "Vd"), flown.velocity_n.T / FOOT, strict=True)),
        "Rho": 0 * roll,
        "Altitude": flown.height / FOOT,
        f"Phi{tail}": roll, f"Tht{tail}": pitch, f"Psi{tail}": yaw % (2 * np.pi * factor),
        f"Alpha{tail}": factor * flown.alpha,
        f"Latitude{tail}": factor * flown.latitude,
        f"Longitude{tail}": factor * flown.longitude,
        "Runway Radius": 0 * roll,
    }  # fmt: skip
    rows = "\n".join(", ".join(f"{v:.12g}" for v in row) for row in np.column_stack(list(columns.values())))
    path = tmp_path / "JSBout.csv"
    path.write_text(", ".join(columns) + "\n" + rows + "\n")
    assert reader_of(path).name == "JSBSim csv"
    flight = read_raw(path)
    np.testing.assert_allclose(flight.latitude, flown.latitude, atol=1e-10)
    np.testing.assert_allclose(flight.longitude, flown.longitude, atol=1e-10)
    np.testing.assert_allclose(flight.height, flown.height, rtol=1e-9)
    np.testing.assert_allclose(flight.velocity_n, flown.velocity_n, atol=1e-8)
    np.testing.assert_allclose(np.sin(flight.euler - flown.euler), 0.0, atol=1e-9)
    assert any("geocentric" in remark for remark in flight.remarks)
    assert any("taken as degrees" in remark for remark in flight.remarks) == (degrees and not said)
    # On a sphere and on the ellipsoid a degree is within 1 % as long.
    assert prepare_import(path).report.verdict == "plausible"


def test_a_cartesian_position_far_from_the_surface_is_left_out(tmp_path):
    path = tmp_path / "out.csv"
    place = "13000000.0,0.5,16200000.0"  # 6331 km from the centre
    rows = [f"{t},20925700.0,{10 * t},0.0" for t in range(12)]
    rows[3] = "3,0.5,0.25,-900.0"
    rows[8] = f"8,{place}"
    path.write_text("Time,X_{ECEF} (ft),Y_{ECEF} (ft),Z_{ECEF} (ft)\n" + "\n".join(rows) + "\n")
    flight = read_raw(path)
    assert len(flight.time) == 10
    assert np.abs(flight.latitude).max() < 1e-3
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(2, 5)]
    path.write_text(path.read_text().replace("20925700", "20902"))
    with pytest.raises(MissionError, match=r"0 of 12 rows.*Earth-fixed position"):
        read_raw(path)

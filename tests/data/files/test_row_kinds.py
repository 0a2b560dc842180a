"""Texts whose rows are of several kinds, as JSON and long tables, and velocities in a file of their own."""

from __future__ import annotations

import json

import numpy as np
import pytest
from foreign_tables import UNIX, is_track, moment, motion, phone, same, table

from lab.data.formats import read_raw
from lab.data.sheets.json_tables import json_tables
from lab.missions import MissionError
from lab.missions.flight_import import any_log, read_log


def objects(made):
    """Return what Sensor Logger writes in JSON: an object for each sample of each sensor, of texts."""
    imu, gnss = made
    speed, course = motion(gnss)
    vectors = {"Gyroscope": phone(imu[:, 1:4]), "TotalAcceleration": phone(imu[:, 4:])}
    found = [
        (t, {"sensor": name, "time": f"{(UNIX + t) * 1e9:.0f}", "seconds_elapsed": f"{t - imu[0, 0]:.6f}"}
         | dict(zip("xyz", map(repr, map(float, row)), strict=True)))
        for name, rows in vectors.items() for t, row in zip(imu[:, 0], rows, strict=True)
    ]  # fmt: skip
    found += [
        (g[0], {"sensor": "Location", "time": f"{(UNIX + g[0]) * 1e9:.0f}", "speed": repr(float(v)),
                "bearing": repr(float(c)), "altitude": repr(float(g[3])), "longitude": repr(float(g[2])),
                "latitude": repr(float(g[1]))})
        for g, v, c in zip(gnss, speed, course, strict=True)
    ]  # fmt: skip
    found.sort(key=lambda pair: pair[0])
    return [{"sensor": "Metadata", "platform": "android", "standardisation": "false"}] + [o for _, o in found]


@pytest.mark.parametrize("form", ["array", "lines", "indented", "batches"])
def test_a_recording_of_sensor_logger_in_json(tmp_path, made, expected, form):
    rows = objects(made)
    texts = {
        "array": json.dumps(rows),
        "lines": "\n".join(map(json.dumps, rows)),
        "indented": json.dumps(rows, indent=2),
        "batches": json.dumps(
            [{"messageId": i, "payload": rows[i : i + 99]} for i in range(0, len(rows), 99)]
        ),
    }
    (tmp_path / "phone.json").write_text(texts[form])
    same(read_log([tmp_path / "phone.json"]), expected, 1e-5)


def positions(made):
    """Return a report of gpsd for each fix (gpsd_json(5)), and between them one of the satellites."""
    _, gnss = made
    speed, course = motion(gnss)
    for g, v, c in zip(gnss, speed, course, strict=True):
        yield {"class": "TPV", "mode": 3, "time": moment(g[0], "%Y-%m-%dT%H:%M:%S.%fZ"), "lat": g[1],
               "lon": g[2], "altHAE": g[3], "track": c, "speed": v, "climb": -g[6], "eph": 3.0}  # fmt: skip
        yield {"class": "SKY", "hdop": 0.9, "satellites": [{"PRN": 1, "el": 10.0, "az": 20.0, "used": True}]}


def test_lines_of_gpsd_are_a_flight(tmp_path, made):
    path = tmp_path / "gpsd.log"
    path.write_text("\n".join(map(json.dumps, [{"class": "VERSION", "release": "3.25"}, *positions(made)])))
    flight = read_raw(path)
    is_track(flight, made)
    np.testing.assert_allclose(flight.velocity_n[:, 2], made[1][:, 6], atol=1e-6)
    assert any("altHAE" in remark for remark in flight.remarks)


@pytest.mark.parametrize("before", ["", "2023-11-14T22:13:20Z\t*                 \t"])
def test_owntracks_counts_kilometres_an_hour(tmp_path, made, before):
    _, gnss = made
    speed, course = motion(gnss)
    rows = [
        {"_type": "location", "tst": UNIX + g[0], "lat": g[1], "lon": g[2], "alt": g[3], "acc": 5,
         "vel": 3.6 * v, "cog": c, "tid": "ab"}
        for g, v, c in zip(gnss, speed, course, strict=True)
    ]  # fmt: skip
    path = tmp_path / "owntracks.rec"
    path.write_text("\n".join(before + json.dumps(row) for row in rows))
    flight = read_raw(path)
    is_track(flight, made)
    np.testing.assert_allclose(flight.velocity_n[:, 0], gnss[:, 4], atol=1e-6)


def test_points_of_geojson_are_a_flight(tmp_path, made):
    features = [
        {"type": "Feature", "properties": {"time": moment(g[0], "%Y-%m-%dT%H:%M:%S.%fZ")},
         "geometry": {"type": "Point", "coordinates": [g[2], g[1], g[3]]}}
        for g in made[1]
    ]  # fmt: skip
    path = tmp_path / "track.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    is_track(read_raw(path), made)


NESTED = '{"a":' * 3000
DAMAGED = {
    "cut": lambda text: text[: len(text) // 2],
    "a line of noise": lambda text: text.replace("\n", '\n{"class": "TPV", "lat": [[[\n', 3),
    "nested": lambda text: text.replace("\n", f"\n{NESTED}\n", 2),
    "nulls": lambda text: text.replace('"speed"', '"speed": null, "spede"'),
    "remarks before": lambda text: f"# recorded by x\n// 2026\n{text}",
    "mixed ends of lines": lambda text: text.replace("\n", "\r\n", 40),
    "keys with commas": lambda text: text.replace('"mode"', '"a,b;\\n\\"c\\t"'),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_what_is_sound_in_damaged_json_is_read(tmp_path, made, damage):
    path = tmp_path / "gpsd.json"
    text = "\n".join(map(json.dumps, positions(made)))
    path.write_bytes(DAMAGED[damage](text).encode())
    flight = read_raw(path)
    count = len(made[1]) // 2 if damage == "cut" else len(made[1])
    assert count - 5 <= len(flight.time) <= count
    np.testing.assert_allclose(np.degrees(flight.latitude[:9]), made[1][:9, 1], atol=1e-9)


def test_objects_that_are_never_closed_cost_no_time():
    text = b'{"a":[1,\n' * 900 + b"1," * 200_000
    assert json_tables(text) == []


def test_keys_of_few_objects_do_not_widen_the_others_without_bound():
    wide = json.dumps({f"k{i}": i for i in range(1000)})
    text = (wide + '{"k999":1}' * 50_000).encode()
    assert sum(len(table) for _, table in json_tables(text)) < 5 * len(text)


LONG = {
    "words": ("time,sensor,x,y,z", lambda t, name, v: (t, name, *v), ("gyroscope", "accelerometer")),
    "values": (
        "timestamp;sensor_name;accuracy;values[0];values[1];values[2]",
        lambda t, name, v: (t, name, 3, *v),
        ("android.sensor.gyroscope", "android.sensor.accelerometer"),
    ),
    "counted": ("Type,Time (s),v1,v2,v3", lambda t, name, v: (name, t, *v), ("Gyro", "Acc")),
}
"""Header, row and names of the sensors of recorders that write a row for each reading of each sensor."""


def long_rows(made, form):
    _, row, names = LONG[form]
    imu, _ = made
    rows = [
        (t + late, row(t + late, name, vector))
        for name, vectors, late in ((names[0], phone(imu[:, 1:4]), 0.0), (names[1], phone(imu[:, 4:]), 2e-3))
        for t, vector in zip(imu[:, 0], vectors, strict=True)
    ] + [(t, row(t, "magnetometer", (20.0, 5.0, -40.0))) for t in imu[::10, 0]]
    return [one for _, one in sorted(rows, key=lambda pair: pair[0])]


@pytest.mark.parametrize("form", LONG)
def test_rows_of_one_sensor_each_are_an_imu(tmp_path, made, expected, form):
    header = LONG[form][0]
    imu = table(tmp_path / "all.csv", header, long_rows(made, form), ";" if ";" in header else ",")
    _, gnss = made
    fixes = table(tmp_path / "gps.csv", "time,lat,lon,alt,vn,ve", gnss[:, :6])
    log = read_log([imu, fixes])
    assert len(log.dtheta) >= len(expected.dtheta) - 1
    np.testing.assert_allclose(log.rates[0][:500], expected.rates[0][-len(log.dtheta) :][:500], atol=1e-5)
    with pytest.raises(MissionError, match="It has an IMU, but no positions"):
        read_log([imu])


ABOVE = {
    "no header": ("", ""),
    "remarks": ("# recorded today\n\n# with a phone\n", "time,sensor,x,y,z\n"),
    "a title": ("Recording of today\nPixel 6,Android\n\n", "time,sensor,x,y,z\n"),
}


@pytest.mark.parametrize("form", ABOVE)
def test_rows_of_one_sensor_each_may_have_remarks_and_no_header(tmp_path, made, expected, form):
    """Three numbers of a receiver are its place."""
    _, gnss = made
    rows = [(t, name, *v) for t, name, *v in long_rows(made, "words")]
    rows += [(g[0] + 1e-3, "gps", *g[1:4]) for g in gnss]
    lines = [",".join((f"{t:.4f}", name, *(f"{x:.12g}" for x in v))) for t, name, *v in sorted(rows)]
    lines[100:100] = ["# a remark"]
    path = tmp_path / "all.csv"
    path.write_text("".join(ABOVE[form]) + "\n".join(lines) + "\n")
    log = read_log([path])
    np.testing.assert_allclose(log.rates[0][:500], expected.rates[0][-len(log.dtheta) :][:500], atol=1e-5)
    np.testing.assert_allclose(log.gnss.position, expected.gnss.position[-len(log.gnss.time) :], atol=1e-9)


QUANTITIES = {"header": "time,name,value\n", "no header": "", "remark": "# export\nstamp;signal;number\n"}


@pytest.mark.parametrize("form", QUANTITIES)
def test_rows_of_one_quantity_each_are_a_log(tmp_path, made, expected, form):
    imu, gnss = made
    names = [f"{word}_{axis}" for word in ("gyro", "acc") for axis in "xyz"]
    rows = [(t, name, x) for t, *v in imu for name, x in zip(names, v, strict=True)]
    names = ["latitude", "longitude", "altitude", "vn", "ve"]
    rows += [(g[0], name, x) for g in gnss for name, x in zip(names, g[1:6], strict=True)]
    lines = [f"{t:.6f},{name},{x:.15g}" for t, name, x in sorted(rows)]
    text = QUANTITIES[form] + "\n".join(lines) + "\n"
    (tmp_path / "all.csv").write_text(text.replace(",", ";") if ";" in text else text)
    log = read_log([tmp_path / "all.csv"])
    np.testing.assert_allclose(log.rates[0], expected.rates[0][-len(log.dtheta) :], atol=1e-6)
    np.testing.assert_allclose(log.gnss.velocity_n[:, :2], gnss[:, 4:6], atol=1e-6)


def test_a_table_of_one_kind_stays_one(tmp_path, made):
    """A column named sensor with no gyros and accelerometers in it splits nothing."""
    rows = [(f"{g[0]:.2f}", "gps", *g[1:4]) for g in made[1]]
    is_track(read_raw(table(tmp_path / "one.csv", "time,sensor,lat,lon,alt", rows)), made)


VELOCITIES = {
    "components": ("time,vn,ve", lambda gnss, *_: gnss[:, 4:6]),
    "speed and course": ("time,speed,course", lambda _, v, c: np.column_stack((v, c))),
    "in km/h": ("time,vn [km/h],ve [km/h]", lambda gnss, *_: 3.6 * gnss[:, 4:6]),
}


@pytest.mark.parametrize("form", VELOCITIES)
def test_velocities_in_a_file_of_their_own_are_those_of_the_positions(tmp_path, made, expected, form):
    imu, gnss = made
    header, columns = VELOCITIES[form]
    paths = [
        table(tmp_path / "imu.csv", "time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", imu),
        table(tmp_path / "place.csv", "time,latitude,longitude,altitude", gnss[:, :4]),
        table(
            tmp_path / "velocity.csv",
            header,
            np.column_stack((gnss[:, 0], columns(gnss, *motion(gnss)))),
        ),
    ]
    same(any_log(paths), expected, 1e-5)
    flight = read_raw(paths[1:])
    np.testing.assert_allclose(flight.velocity_n[:, :2], gnss[:, 4:6], atol=1e-5)
    assert any("velocity.csv" in remark and "place.csv" in remark for remark in flight.remarks)


def test_an_attitude_beside_the_velocities_stays(tmp_path, made):
    _, gnss = made
    place = table(tmp_path / "place.csv", "time,latitude,longitude,altitude", gnss[:, :4])
    course = motion(gnss)[1]
    rows = np.column_stack((gnss[:, 0], gnss[:, 4:6], 0 * course, 0 * course, course))
    beside = table(tmp_path / "v.csv", "time,vn,ve,roll [deg],pitch [deg],yaw [deg]", rows)
    flight = read_raw([place, beside])
    assert flight.euler is not None
    np.testing.assert_allclose(flight.velocity_n[:, 0], gnss[:, 4], atol=1e-6)
    assert not any("Columns not read" in remark for remark in flight.remarks)


def test_velocities_of_other_times_are_interpolated_or_left_out(tmp_path, made):
    _, gnss = made
    times = np.arange(gnss[0, 0], gnss[-1, 0], 0.1)
    north, east = (np.interp(times, gnss[:, 0], gnss[:, 4 + i]) for i in (0, 1))
    place = table(tmp_path / "place.csv", "time,latitude,longitude,altitude", gnss[:, :4])
    dense = table(tmp_path / "v.csv", "time,vn,ve", np.column_stack((times, north, east)))
    flight = read_raw([place, dense])
    np.testing.assert_allclose(flight.velocity_n[:, 0], gnss[:-1, 4], atol=1e-6)
    later = table(tmp_path / "later.csv", "time,vn,ve", np.column_stack((times + 1e5, north, east)))
    assert (
        read_raw([place, later]).velocity_n is None
        or np.isnan(read_raw([place, later]).velocity_n[:, 0]).all()
    )


def test_vehicles_whose_names_differ_by_zeros_are_two(tmp_path, made):
    _, gnss = made
    lines = ["vehicle_id,time,lat,lon,alt"]
    for g in gnss:
        lines += [f"007,{g[0]},{g[1]:.9f},{g[2]:.9f},{g[3]}", f"7,{g[0] + 0.1},{g[1] + 1:.9f},{g[2]:.9f},0"]
    path = tmp_path / "fleet.csv"
    path.write_text("\n".join(lines))
    flight = read_raw(path)
    is_track(flight, made)
    assert any("007" in remark and "not 7" in remark for remark in flight.remarks)


DAMAGED_TABLES = {
    "a line ends as on an old Macintosh": lambda text: text.replace("\n", "\r", 1),
    "a quote without a second": lambda text: ',"'.join(
        (text[: text.index(",", 300)], text[text.index(",", 300) + 1 :])
    ),
    "all lines end so": lambda text: text.replace("\n", "\r"),
}


@pytest.mark.parametrize("damage", DAMAGED_TABLES)
def test_a_damaged_end_or_quote_costs_a_row_at_most(tmp_path, made, damage):
    _, gnss = made
    path = table(tmp_path / "gps.csv", "time,latitude,longitude,altitude", gnss[:, :4])
    path.write_bytes(DAMAGED_TABLES[damage](path.read_text()).encode())
    assert len(read_raw(path).time) >= len(gnss) - 1


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("time,Roll,Pitch\n1,2.5,3\n2,2.5,3\n", "none of its headings names a position, a gyro or an acc"),
        ("Ville,Latitude,Longitude\nRouen,49.4,1.09\nParis,48.8,2.35\n", "none of its headings names a time"),
        ("4.7e+01,8.5e+00,5.3e+02\n4.7e+01,8.5e+00,5.3e+02\n", "headings do not say what its columns are"),
    ],
)
def test_tables_without_a_time_or_a_header_are_refused_for_that(tmp_path, text, reason):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(MissionError, match=reason):
        read_raw(path)


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        (
            "fixTime,latitude,longitude,altitude,speed,course",
            lambda g, v, c: (moment(g[0], "%Y-%m-%d %H:%M:%S.%f"), *g[1:4], v, c),
        ),
        ("GPSW,GPSSoW,latitude(deg),longitude(deg),height(m)", lambda g, *_: (2288, g[0] + 1e5, *g[1:4])),
        (",lat,lon,alt,crs,hac,vac,spd,t", lambda g, v, c: (0, *g[1:4], c, 5, 3, v, 1e3 * (UNIX + g[0]))),
    ],
)
def test_short_names_of_trackers(tmp_path, made, header, rows):
    """Traccar, Rokubun Jason, and an iPhone."""
    _, gnss = made
    speed, course = motion(gnss)
    flight = read_raw(table(tmp_path / "t.csv", header, list(map(rows, gnss, speed, course))))
    is_track(flight, made)
    if "spd" in header or "speed" in header:
        np.testing.assert_allclose(flight.velocity_n[:, 0], gnss[:, 4], atol=1e-5)


def test_a_csv_of_fit_has_name_value_and_unit_in_three_cells(tmp_path, made):
    """FitCSVTool of the FIT SDK: positions in semicircles, values in quotes."""
    lines = ["Type,Local Number,Message,Field 1,Value 1,Units 1,Field 2,Value 2,Units 2,",
             "Definition,0,record,timestamp,1,,position_lat,1,,position_long,1,,enhanced_altitude,1,,",
             'Data,3,event,timestamp,"1000000000",s,event,"0",,']  # fmt: skip
    for g in made[1]:
        degrees = 2**31 / 180
        lines.append(
            f'Data,0,record,timestamp,"{g[0]}",s,position_lat,"{round(g[1] * degrees)}",semicircles,'
            f'position_long,"{round(g[2] * degrees)}",semicircles,enhanced_altitude,"{g[3]}",m,'
        )
    path = tmp_path / "activity.csv"
    path.write_text("\n".join([*lines, 'Data,0,record,"cut', "Data", '"a,b,c"', ""]))
    is_track(read_raw(path), made)

"""Exports of phyphox in other languages: headings, decimal commas, and other sensors beside them."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from foreign_tables import phone, table
from phone_drive import drive

from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sensor_csv import recognises
from lab.missions.flight_import import read_log

LANGUAGES = {
    "de": ("Zeit", "Beschleunigung", "Gyroskop", "Magnetfeld", "Druck",
           ("Breite", "Länge", "Höhe", "Geschwindigkeit", "Richtung", "Horizontale Genauigkeit",
            "Vertikale Genauigkeit")),
    "fr": ("Temps", "Accélération", "Gyroscope", "Champ magnétique", "Pression",
           ("Latitude", "Longitude", "Hauteur", "Vitesse", "Direction", "Précision horizontale",
            "Précision verticale")),
    "es": ("Tiempo", "Aceleración", "Giroscopio", "Campo magnético", "Presión",
           ("Latitud", "Longitud", "Altura", "Velocidad", "Dirección", "Precisión horizontal",
            "Precisión vertical")),
    "it": ("Tempo", "Accelerazione", "Giroscopio", "Campo magnetico", "Pressione",
           ("Latitudine", "Longitudine", "Altezza", "Velocità", "Direzione", "Precisione orizzontale",
            "Precisione verticale")),
}  # fmt: skip
UNITS = ("°", "°", "m", "m/s", "°", "m", "m")


def heading(*cells):
    return ";".join(f'"{cell}"' for cell in cells)


def write(folder, name, cells, rows):
    return table(folder / f"{name}.csv", heading(*cells), rows, ";", comma=True)


@pytest.fixture(params=LANGUAGES)
def export(request, tmp_path):
    """Return a zip file as phyphox writes it, and the words of its language."""
    words = LANGUAGES[request.param]
    time, force, rate, field, pressure, place = words
    one, folder = drive(), tmp_path / "phyphox"
    folder.mkdir()
    first = f"{time} (s)"

    def axes(name, unit):
        return (first, *(f"{name} {axis} ({unit})" for axis in "xyz"))

    write(folder, force, axes(force, "m/s^2"), np.column_stack((one.time, phone(one.force))))
    write(folder, rate, axes(rate, "rad/s"), np.column_stack((one.time, phone(one.rate))))
    write(folder, field, axes(field, "µT"), np.column_stack((one.time, 30 + 0 * one.force)))
    write(folder, pressure, (first, f"{pressure} (hPa)"), np.column_stack((one.time, 980 + 0 * one.time)))
    accuracy = np.tile((3.03, 3.0), (one.at.size, 1))
    fixes = np.column_stack((one.at, one.position, one.speed, one.course, accuracy))
    named = (f"{name} ({unit})" for name, unit in zip(place, UNITS, strict=True))
    write(folder, place[0], (first, *named), fixes)
    with zipfile.ZipFile(folder.with_suffix(".zip"), "w") as archive:
        for path in folder.iterdir():
            archive.write(path, path.name)
    return folder.with_suffix(".zip"), words


@pytest.mark.proof
def test_an_export_in_another_language_is_read(export):
    path, (_, force, rate, *_) = export
    one, log = drive(), read_log([path], vehicle="car")
    at = log.time[1:] + log.epoch
    for seen, true in ((log.rates[0], one.rate), (log.rates[1], one.force)):
        inside = (at > one.at[0]) & (at < one.at[-1])
        there = np.column_stack([np.interp(at, one.time, column) for column in true.T])
        np.testing.assert_allclose(seen[inside], there[inside], atol=2e-6)
    np.testing.assert_allclose(log.gnss.position[:, 2], one.position[:, 2], atol=1e-6)
    np.testing.assert_allclose(log.gnss.velocity_n[:, :2], one.velocity, atol=1e-6)
    np.testing.assert_allclose(log.gnss.position_sigma, np.tile((2, 2, 3), (one.at.size, 1)), rtol=1e-3)
    report = " ".join(log.repairs)
    assert f"{rate} x (rad/s)" in report and f"{force} x (m/s^2)" in report


def test_a_single_table_in_german_is_recognised_whatever_its_encoding():
    head = (
        "Zeit (s);Beschleunigung x (m/s²);Beschleunigung y (m/s²);Beschleunigung z (m/s²);"
        "Drehrate x (°/s);Drehrate y (°/s);Drehrate z (°/s);Geogr. Breite;Geogr. Länge;GPS-Höhe (m)\n1;2\n"
    )
    for encoding in ("utf-8", "cp1252", "utf-16"):
        assert recognises(head.encode(encoding))


@pytest.mark.parametrize(
    "text", ["Ortho", "cap_ok", "Temperature (°C)", "Magnetfeld (µT)", "Reifendruck (hPa)"]
)
def test_other_words_name_nothing(text):
    assert heading_of(text) is None

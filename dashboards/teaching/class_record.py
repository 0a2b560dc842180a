"""Class record: the classes of a server, with what their teachers show, as plain data for the next server."""

from __future__ import annotations

from typing import Any

from dashboards.classroom import catalogue
from dashboards.notes import notes_of_query, query_of_notes
from dashboards.query import experiment_of_query, query, with_settings_of
from dashboards.teaching.class_register import CLASSES, MOST, is_code
from dashboards.teaching.moment import Moment
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.missions import missions


def written_classes() -> list[dict[str, Any]]:
    """Return the classes of this process."""
    return [{"code": one.code, "age": one.age, "moment": _written(one.moment)} for one in CLASSES.classes()]


def open_classes(found: list[Any]) -> None:
    """Open classes that a server before this one had; what is no class counts as nothing."""
    for one in found[:MOST]:
        if isinstance(one, dict) and is_code(str(one.get("code"))):
            age = one.get("age")
            age = float(age) if isinstance(age, int | float) and age >= 0 else 0.0
            CLASSES.open_again(str(one["code"]), age, _moment(one.get("moment")))


def _written(moment: Moment | None) -> dict[str, Any] | None:
    """Return what a teacher shows as plain data; None if there is nothing, or if it hides a homework."""
    if moment is None:
        return None
    experiment = moment.experiment
    if experiment.hidden and (moment.place is None or not isinstance(experiment, FaultyExperiment)):
        return None
    return {
        "settings": query(experiment),
        "hides": bool(experiment.hidden),
        "page": moment.page,
        "time": moment.time,
        "place": None if moment.place is None else [*moment.place[0], moment.place[1]],
        "notes": query_of_notes(moment.notes, experiment.mission),
    }


def _moment(parts: object) -> Moment | None:
    """Return what a teacher showed from plain data; None if it cannot be shown any more."""
    match parts:
        case {
            "settings": str(settings),
            "hides": bool(hides),
            "page": str(page),
            "time": int() | float() as cursor,
            "place": None | [str(), str(), int()] as where,
            "notes": str(notes),
        } if 0 <= cursor < float("inf"):
            experiment, _ = experiment_of_query(settings)
            place = None if where is None else ((where[0], where[1]), max(where[2], 0))
            lesson = catalogue().find(*place[0]) if place is not None else None
            if hides and lesson is not None and lesson.fault:
                experiment = with_settings_of(FaultyExperiment(FAULTS[lesson.fault]), experiment)
            elif hides:
                return None
            if experiment.mission not in missions():
                return None
            written, _ = notes_of_query(notes, experiment.mission)
            return Moment(experiment, page, float(cursor), place, notes=written)
    return None

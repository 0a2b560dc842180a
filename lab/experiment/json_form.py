"""JSON form: results, ensembles and sweeps as plain data of fixed forms; ``docs/json.md`` has each field.

A version only ever gains fields. One that changes or loses a field gets the next number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.base.parameters.setting_kinds import is_changed
from lab.base.plain_data import to_plain_data
from lab.experiment.ensembles.run_at_fixes import mean_of_known

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from lab.analysis.identification.identification import Identification
    from lab.analysis.verdicts.finding import Change, Finding, Suggestion, Verdict
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result
    from lab.experiment.sweep import Sweep
    from lab.run.experiment_settings import ExperimentSettings

VECTORS = {"position": "position", "velocity": "velocity", "heading": "attitude heading"}
"""Errors of a point of a sweep, and the quantities of each; of a vector, the components together."""
COLUMNS = {
    "95 %": "p95",
    "mean [σ]": "mean_sigma",
    "within ±1σ [%]": "inside_1_sigma",
    "within ±3σ [%]": "inside_3_sigma",
    "mean ±": "mean_bound",
    "variance from": "variance_low",
    "variance to": "variance_high",
    "Q": "ljung_box",
    "p white": "p_white",
}
"""Names of fields, by the titles of those columns that have another one."""


def result_to_json(result: Result, budget: bool, identification: Identification | None) -> dict[str, Any]:
    """Return a result as plain data; see `Result.to_dict`."""
    experiment, log = result.experiment, result.recorded
    missing = {name: result.missing_reason(name) for name in ("summary", "coverage", "consistency", "budget")}
    found: dict[str, Any] = {
        **{"seed": None, "sealed": None, "algorithm": None},
        **result.facts,
        "duration": float(result.time[-1]),
        "changed": changed_settings(experiment),
        "missing": {name: reason for name, reason in missing.items() if reason},
        "summary": None if missing["summary"] else _rows(result.summary),
        "coverage": None if missing["coverage"] else _rows(result.coverage),
        "nees": None if missing["consistency"] else _squares(result.consistency["nees"]),
        "nis": _squares(result.innovations["nis"]),
        "innovations": _rows(result.whiteness),
        "remarks": result.remarks,
        "verdict": _verdict(result.tried_verdict),
        "gaps": None if log is None else {"filled": log.log.gaps, "breaks": log.log.breaks},
        "budget": budget_to_json(result.budget.isel(time=-1)) if budget and not missing["budget"] else None,
        "identification": None if identification is None else identification_to_json(identification),
    }
    form: dict[str, Any] = to_plain_data(found)
    return form


def ensemble_json(ensemble: Ensemble, verdict: Verdict) -> dict[str, Any]:
    """Return an ensemble as plain data; see `Ensemble.to_dict`."""
    experiment = ensemble.experiment
    known = np.isfinite(ensemble.rms).any()
    remarks = ensemble.remark, experiment.sensors.card_remark(), *experiment.notes
    found: dict[str, Any] = {
        **{"sealed": None, "algorithm": None, "seeds": None},
        **ensemble.facts,
        "runs": len(ensemble.seeds),
        "diverged": [
            {"seed": None if experiment.hidden else seed, "reason": reason}
            for seed, reason in ensemble.diverged.items()
        ],
        "changed": changed_settings(experiment),
        "errors": _errors(ensemble) if known else None,
        "horizontal": {
            "p95": mean_of_known(ensemble.most),
            "outage_end": np.sqrt(mean_of_known(ensemble.horizontal_at_outage_ends**2)),
            "outage_end_p95": np.quantile(ensemble.horizontal_at_outage_ends, 0.95),
        }
        if known
        else None,
        "nees": _mean(float(ensemble.at_fixes.mean_of_all("nees")), ensemble.degrees),
        "nis": _mean(float(ensemble.at_fixes.mean_of_all("nis")), ensemble.nis_degrees),
        "remarks": [remark for remark in remarks if remark],
        "verdict": _verdict(verdict),
    }
    form: dict[str, Any] = to_plain_data(found)
    return form


def _errors(ensemble: Ensemble) -> list[Mapping[Any, Any]]:
    """Return a row for each error of an ensemble."""
    table, sums = ensemble.coverage.copy(), ensemble.at_fixes
    table["p95"] = np.quantile(ensemble.rms, 0.95, axis=0)
    table["fixes_rms"] = np.sqrt(np.diagonal(sums.mean_of_all("product")))
    table["fixes_sigma"] = np.sqrt(sums.mean_of_all("variance"))
    table["outage_end"], table["outage_end_sigma"] = np.sqrt(
        np.mean(ensemble.at_outage_ends.astype(np.float64) ** 2, axis=0)
    )
    return _rows(table)


def sweep_json(sweep: Sweep) -> dict[str, Any]:
    """Return a sweep as plain data; see `Sweep.to_dict`."""
    data, dims = sweep.dataset, sweep.dims
    swept = [
        {
            "setting": data[dim].attrs["setting"],
            "label": data[dim].attrs["long_name"],
            "unit": data[dim].attrs["units"],
            "values": data[dim].values,
        }
        for dim in dims
    ]
    found: dict[str, Any] = {
        **{"sealed": None, "seeds": None},
        **sweep.facts,
        "mission": sweep.mission,
        "swept": swept,
        "points": [
            _point(data.isel(dict(zip(dims, at, strict=True))), dims)
            for at in np.ndindex(*(data.sizes[dim] for dim in dims))
        ],
        "refused": sweep.refused,
    }
    form: dict[str, Any] = to_plain_data(found)
    return form


def _point(there: xr.Dataset, dims: Sequence[str]) -> dict[str, Any]:
    """Return the means over the seeds of a sweep at one combination of values."""
    errors = {}
    for name, quantity in VECTORS.items():
        parts = [one for one in there["quantity"].values if quantity in (one, one.split()[0])]
        chosen = there.sel(quantity=parts)
        rms, sigma = (
            np.sqrt(mean_of_known(np.sum(chosen[one].values ** 2, axis=-1))) for one in ("rms", "sigma")
        )
        errors[name] = {"unit": chosen["unit"].values[0], "rms": rms, "sigma": sigma}
    tests = {
        name: _mean(mean_of_known(there[name].values), mean_of_known(there[f"{name}_degrees"].values))
        for name in ("nees", "nis")
    }
    return {
        "values": {there[dim].attrs["setting"]: there[dim].item() for dim in dims},
        "runs": np.isfinite(there["nis_degrees"].values).sum(),
        **errors,
        "horizontal_95": mean_of_known(there["horizontal_95"].values),
        **tests,
    }


def _mean(mean: float, expected: float) -> dict[str, float] | None:
    """Return a mean of NEES or NIS beside its expected value; None if it is unknown."""
    return {"mean": mean, "expected": expected} if np.isfinite(mean) and expected else None


def changed_settings(experiment: ExperimentSettings) -> dict[str, Any]:
    """Return the settings that differ from their defaults by their paths; not a seed that is hidden."""
    changed = {leaf[0]: getattr(leaf[1], leaf[2]) for leaf in experiment.leaves() if is_changed(leaf)}
    return {path: value for path, value in changed.items() if path != "seed" or not experiment.hidden}


def budget_to_json(there: xr.Dataset) -> dict[str, Any]:
    """Return an error budget at one time as plain data, each quantity separately."""
    quantities = []
    for quantity in there.quantity.values:
        column = there.sel(quantity=quantity)
        sources = zip(column.source.values, column.sigma.values, column.share.values, strict=True)
        quantities.append(
            {
                "quantity": quantity,
                "unit": column.unit.item(),
                "total": column.total.item(),
                "believed": column.believed.item(),
                "sources": [
                    {"source": source, "sigma": sigma, "percent": share} for source, sigma, share in sources
                ],
            }
        )
    return {"time_s": there.time.item(), "quantities": quantities, "left_out": there.attrs["left_out"]}


def identification_to_json(found: Identification) -> dict[str, Any]:
    """Return an identification as plain data."""
    facts = {one.name: getattr(found, one.name) for one in fields(found) if one.name != "changes_of"}
    return {
        **facts,
        "rows": [row._asdict() for row in found.rows],
        "before": found.before._asdict(),
        "after": found.after._asdict(),
        "recommended": found.recommended,
        "remarks": found.remarks,
    }


def _rows(table: pd.DataFrame) -> list[Mapping[Any, Any]]:
    return list(table.rename(columns=COLUMNS).to_dict("records"))


def _squares(values: xr.DataArray) -> dict[str, Any] | None:
    """Return mean, expected value and share inside the 95 % interval of NEES or NIS; None without values."""
    known, degrees = values.values[np.isfinite(values.values)], values.attrs["degrees"]
    if not known.size or not degrees:
        return None
    low, high = chi_square_interval(degrees)
    inside = 100 * np.mean((known >= low) & (known <= high))
    return {"mean": known.mean(), "expected": degrees, "inside_95": inside, "count": known.size}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {
        "consistent": verdict.consistent,
        "headline": verdict.headline,
        "basis": verdict.basis,
        "findings": [_finding(one) for one in verdict.findings],
        "suggestions": [
            {"sentence": one.sentence, "advice": one.advice, "changes": _changes(one)}
            for one in verdict.suggestions
        ],
    }


def _finding(finding: Finding) -> dict[str, Any]:
    values = {one.name: getattr(finding, one.name) for one in fields(finding)}
    return {**values, "changes": _changes(finding)}


def _changes(advised: Finding | Suggestion) -> list[dict[str, Any]]:
    changes: Sequence[Change] = advised.changes
    return [one._asdict() for one in changes]

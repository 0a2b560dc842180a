"""Release: what states the version, the requirements or the address of the repository agrees."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import lab

ROOT = Path(__file__).parent.parent
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
HOOK = runpy.run_path(str(ROOT / "hatch_build.py"))
README = (ROOT / "README.md").read_text("utf-8")
RELATIVE = re.compile(r"(?:\]\(|src=\"|srcset=\")(?!https?://|#)[^)\"]+")
"""A link or a picture that leads nowhere on the page of an index."""


def text_of(name: str) -> str:
    return (ROOT / name).read_text("utf-8")


def test_the_version_is_the_same_everywhere() -> None:
    for name, pattern in {
        "CITATION.cff": r"^version: (.+)$",
        "packaging/conda/recipe.yaml": r'^  version: "(.+)"$',
        "CHANGELOG.md": r"^## (\S+)$",
    }.items():
        (stated, *_) = re.findall(pattern, text_of(name), re.M)
        assert stated == lab.__version__, name
    named = re.findall(r"ins_lab-([\d.]+)-py3", text_of("docs/installing.md") + README)
    named += re.findall(r"\*INS Lab\*, version ([\d.]+),", text_of("docs/site/index.md"))
    assert len(named) > 3
    assert set(named) == {lab.__version__}


def test_the_recipe_for_conda_requires_what_the_wheel_requires() -> None:
    run = text_of("packaging/conda/recipe.yaml").partition("  run:\n")[2].partition("\n\n")[0]
    stated = {Requirement(line.removeprefix("    - ")) for line in run.splitlines()}
    needed = {Requirement(one) for one in PROJECT["dependencies"]}
    assert stated == needed | {Requirement(f"python{PROJECT['requires-python']}")}


def test_the_tested_versions_are_within_the_bounds() -> None:
    tested = dict(re.findall(r"^([\w.-]+)==(\S+)$", text_of("requirements/tested.txt").lower(), re.M))
    needed = [one for part in PROJECT["optional-dependencies"].values() for one in part]
    for requirement in map(Requirement, [*PROJECT["dependencies"], *needed]):
        if requirement.name in tested:
            assert Version(tested[requirement.name]) in requirement.specifier, requirement
    assert {Requirement(one).name for one in PROJECT["dependencies"]} <= tested.keys()


@pytest.mark.parametrize("host", ["https://github.com/somebody", "https://gitlab.com/some/body"])
def test_on_an_index_pictures_and_links_lead_to_the_files_of_the_version(host: str) -> None:
    assert RELATIVE.findall(README)
    made = HOOK["readme_of"](README, f"{host}/ins-lab", "9.8.7")
    assert RELATIVE.findall(made) == []
    leads = re.findall(rf"{host}/ins-lab/(raw|blob)/v9\.8\.7/([^)\"#]+)", made)
    assert {kind for kind, _ in leads} == {"raw", "blob"}
    for kind, path in leads:
        assert (ROOT / path).is_file(), path
        assert (kind == "raw") == path.endswith(".png")


def test_without_an_address_the_readme_has_no_pictures_and_no_relative_links() -> None:
    made = HOOK["readme_of"](README, f"{HOOK['UNKNOWN']}ins-lab", "9.8.7")
    assert RELATIVE.findall(made) == []
    assert "<picture>" not in made
    assert made.count("*Picture: ") == README.count("<picture>")
    assert "example.org/ins-lab" not in made


def test_the_address_of_the_repository_stands_in_one_place() -> None:
    address = PROJECT["urls"]["Repository"]
    documents = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / ".github").rglob("*.yml")]
    assert [path.name for path in documents if address in path.read_text("utf-8")] == []


def test_what_the_files_of_a_release_name_exists() -> None:
    for name in (
        "HOW_TO_RELEASE.md",
        "CHANGELOG.md",
        "SECURITY.md",
        "CODE_OF_CONDUCT.md",
        "packaging/README.md",
    ):
        text, folder = text_of(name), (ROOT / name).parent
        for link in re.findall(r"\]\((?!https?://)([^)#]+)", text):
            assert (folder / link).exists(), f"{name}: {link}"
        for path in re.findall(r"`((?:lab|tests|docs|packaging|requirements|\.ci)/[\w./-]*\w)", text):
            assert (ROOT / path).exists(), f"{name}: {path}"
    for script in re.findall(r"run: (\.ci/\w+)", text_of(".github/workflows/tests.yml")):
        assert (ROOT / script).stat().st_mode & 0o100, script


def test_hooks_run_what_make_runs() -> None:
    hooks = re.findall(r"entry: \.venv/bin/(.+)", text_of(".pre-commit-config.yaml"))
    made = re.findall(r"^\t\$\(BIN\)/((?:ruff|mypy).*)$", text_of("Makefile"), re.M)
    assert [hook.removesuffix(" --force-exclude") for hook in hooks] == made

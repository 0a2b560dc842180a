"""What is installed: the wheel, the source distribution, and how fast the package imports."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib.metadata import packages_distributions, requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

import lab

ROOT = Path(__file__).parent.parent
IMPORT_SECONDS = 1.5


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build wheel and source distribution from what git would hand out, without asking the network."""
    folder = tmp_path_factory.mktemp("distributions")
    source = folder / "source"
    leave = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache", ".hypothesis", "test-results")
    shutil.copytree(ROOT, source, ignore=leave)
    build = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder)]
    done = subprocess.run(build, cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def _wheel_names(folder: Path) -> set[str]:
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.mark.proof
def test_the_wheel_holds_every_module_and_nothing_beside(distributions: Path) -> None:
    names = _wheel_names(distributions)
    modules = {
        path.relative_to(ROOT).as_posix()
        for top in ("lab", "dashboards")
        for path in (ROOT / top).rglob("*.py")
    }
    assert modules <= names
    assert "lab/py.typed" in names
    assert {name.split("/")[0] for name in names} == {
        "lab",
        "dashboards",
        f"ins_lab-{lab.__version__}.dist-info",
    }


def test_the_wheel_holds_missions_notebooks_and_all_other_data(distributions: Path) -> None:
    names = _wheel_names(distributions)
    shipped = {f"lab/missions/shipped/{path.name}" for path in (ROOT / "missions").iterdir()}
    assert any(name.endswith("montreal.csv.gz") for name in shipped)
    shipped |= {
        f"lab/classroom/exercises/notebooks/{path.name}" for path in (ROOT / "notebooks").glob("*.py")
    }
    assert any(name.endswith("01_tour.py") for name in shipped)
    assert shipped <= names
    data = {
        path.relative_to(ROOT).as_posix()
        for top in ("lab", "dashboards")
        for path in (ROOT / top).rglob("*")
        if path.is_file() and path.suffix != ".py" and path.parent.name != "__pycache__"
    }
    assert data <= names


def test_the_metadata_have_a_readme_without_relative_links_and_the_address(distributions: Path) -> None:
    (wheel,) = distributions.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        metadata = archive.read(f"ins_lab-{lab.__version__}.dist-info/METADATA").decode()
    head, _, readme = metadata.partition("\n\n")
    assert "Description-Content-Type: text/markdown" in head
    assert "Project-URL: Repository, https://" in head
    assert "# INS Lab" in readme
    assert not re.findall(r"\]\((?!https?://|#)|srcset=|src=\"(?!https://)", readme)


def test_the_source_distribution_builds_the_same_wheel(distributions: Path, tmp_path: Path) -> None:
    (archive,) = distributions.glob("*.tar.gz")
    shutil.unpack_archive(archive, tmp_path)
    (source,) = tmp_path.glob("ins_lab-*")
    for name in (
        "README.md",
        "docs/README.md",
        "LICENSE",
        "Makefile",
        "tests/conftest.py",
        "notebooks/01_tour.py",
    ):
        assert (source / name).is_file(), name
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(build, cwd=source, check=True, capture_output=True)
    assert _wheel_names(tmp_path) == _wheel_names(distributions)


def test_the_package_imports_fast() -> None:
    timing = "import time; t = time.perf_counter(); import lab; print(time.perf_counter() - t)"
    seconds = [
        float(
            subprocess.run([sys.executable, "-c", timing], capture_output=True, text=True, check=True).stdout
        )
        for _ in range(3)
    ]
    print(f"import lab: {min(seconds):.2f} s (fresh interpreter, best of 3)")
    assert min(seconds) <= IMPORT_SECONDS


HEAVY = {
    *("scipy.fft", "scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.stats"),
    *("pandas", "xarray", "numba.np.arraymath", "holoviews", "bokeh", "panel", "jsbsim", "rich"),
}
"""Modules without which a flight is simulated, navigated and judged; each takes a tenth of a second and more.
Numba's one stands for all that it can compile: kernels on the disk are loaded without the compiler."""


def test_a_run_with_its_table_and_verdict_loads_nothing_else() -> None:
    script = (
        "import sys\n"
        "from dashboards.command_line import main\n"
        "sys.argv = ['ins-lab', 'run', 'montreal']\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    print(end.code, *sys.modules)\n"
    )
    for again in (False, True):  # the first may have to compile
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        code, *modules = done.stdout.splitlines()[-1].split()
        assert code == "0"
        assert not (HEAVY if again else HEAVY - {"numba.np.arraymath"}) & set(modules)


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["missions"], ["notebooks", "list"], ["run", "--help"]]
)
def test_quick_commands_load_neither_compiler_nor_web_server(arguments: list[str]) -> None:
    script = (
        "import json, sys\n"
        "from dashboards.command_line import main\n"
        f"sys.argv = ['ins-lab', *{arguments!r}]\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    code = end.code\n"
        "print(json.dumps([code, sorted({name.split('.')[0] for name in sys.modules})]))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    code, modules = json.loads(done.stdout.splitlines()[-1])
    assert not code
    assert not {"numba", "panel", "bokeh", "holoviews", "viser", "xarray"} & set(modules)


@pytest.mark.parametrize("name", ["numba", "bokeh", "panel", "panel-material-ui", "viser"])
def test_whose_inside_is_used_is_bounded_by_what_was_tested(name: str) -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        needed = tomllib.load(file)["project"]["dependencies"]
    (bounds,) = (Requirement(one).specifier for one in needed if Requirement(one).name == name)
    tested = Version(version(name))
    assert tested in bounds
    assert Version(f"{tested.major}.{tested.minor + 1}") not in bounds


def _comes_with(needed: list[str]) -> set[str]:
    """Return the names of all distributions that an installer brings for some requirements."""
    seen, waiting = set[tuple[str, frozenset[str]]](), list(map(Requirement, needed))
    while waiting:
        one = waiting.pop()
        extras = frozenset(one.extras)
        if (canonicalize_name(one.name), extras) in seen:
            continue
        seen.add((canonicalize_name(one.name), extras))
        for other in map(Requirement, requires(one.name) or []):
            marker = other.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
                waiting.append(other)
    return {name for name, _ in seen}


def test_what_a_module_imports_first_comes_with_an_installation_without_extras() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    named = {
        canonicalize_name(Requirement(one).name)
        for extra in extras.keys() - {"test", "docs"}
        for one in extras[extra]
    }
    there = _comes_with(project["dependencies"]) | named
    homes = packages_distributions()
    missing = []
    for path in (path for top in ("lab", "dashboards") for path in (ROOT / top).rglob("*.py")):
        for node in ast.parse(path.read_text("utf-8")).body:
            modules = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                modules = [node.module]
            tops = {module.partition(".")[0] for module in modules} - sys.stdlib_module_names
            missing += [
                f"{path.relative_to(ROOT)}: {top}"
                for top in tops - {"lab", "dashboards"}
                if not there & set(map(canonicalize_name, homes[top]))
            ]
    assert not missing


OTHER = {
    "lab/__init__.py": '__version__ = "8.10"\n',
    "lab/experiment.py": "",
    "lab/tools.py": "",
    "lab/data/run.py.template": "",
}
"""Some files of the package lab of PyPI, which has nothing to do with INS Lab."""


@pytest.fixture
def together(distributions: Path, tmp_path: Path) -> tuple[Path, Path]:
    """Return a folder with the wheel of INS Lab, and one with another package called lab."""
    (wheel,) = distributions.glob("*.whl")
    shutil.unpack_archive(wheel, tmp_path / "ours", "zip")
    for name, text in OTHER.items():
        path = tmp_path / "other" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return tmp_path / "ours", tmp_path / "other"


def in_folder(folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run Python with the packages of a folder, and all that is installed but for this clone."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), sysconfig.get_path("purelib")])}
    words = [sys.executable, "-S", "-c", script]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


COMMAND = "import sys; sys.argv = ['ins-lab', 'missions']; from dashboards.command_line import main; main()"


@pytest.mark.proof
def test_another_lab_that_was_installed_before_is_noticed_and_all_works(together: tuple[Path, Path]) -> None:
    ours, other = together
    shutil.copytree(ours, other, dirs_exist_ok=True)
    for script in ("import lab; lab.Experiment", COMMAND):
        done = in_folder(other, script)
        assert done.returncode == 0, done.stderr
        for word in ("UserWarning", "another package called lab: experiment.py, tools.py", "pip uninstall"):
            assert word in done.stderr
    assert "montreal" in done.stdout
    assert "UserWarning" not in in_folder(ours, COMMAND).stderr


@pytest.mark.proof
def test_another_lab_that_was_installed_after_is_noticed(together: tuple[Path, Path]) -> None:
    ours, other = together
    shutil.copytree(other, ours, dirs_exist_ok=True)
    after = in_folder(ours, COMMAND)
    for name in OTHER:  # it is uninstalled, with the files that it overwrote
        (ours / name).unlink()
    removed = in_folder(ours, COMMAND)
    (ours / "lab").rename(ours / "elsewhere")  # from a clone, which stands behind all that is installed
    shutil.copytree(other, ours, dirs_exist_ok=True)
    for done in (after, removed, in_folder(ours, COMMAND)):
        assert done.returncode == 1
        assert done.stderr.startswith("ins-lab: the package lab (")
        assert "pip uninstall lab ins-lab" in done.stderr
        assert "Traceback" not in done.stderr

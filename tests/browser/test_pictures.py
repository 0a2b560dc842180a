"""Pictures of the documents: the script takes them from a served page, light and dark, without an old one."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image, ImageStat
from playwright.sync_api import Browser

from tests.browser.conftest import ROOT

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """Return ``docs/pictures.py``."""
    spec = importlib.util.spec_from_file_location("pictures", ROOT / "docs/pictures.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_picture_of_the_script_is_in_the_documents(script: ModuleType) -> None:
    names = {f"{name}-{theme}.png" for name in script.PICTURES for theme in ("light", "dark")}
    assert {path.name for path in script.FOLDER.glob("*.png")} == names


def test_each_notebook_has_its_picture_on_the_page_of_the_tutorials(script: ModuleType) -> None:
    stems = {path.stem for path in (ROOT / "notebooks").glob("*.py")}
    assert set(script.PLOTS) == stems
    found = {path.name for path in (script.FOLDER / "notebooks").glob("*.png")}
    assert found == {f"{stem}-{theme}.png" for stem in stems for theme in ("light", "dark")}
    text = (ROOT / "docs/site/tutorials.md").read_text("utf-8")
    for stem in stems:
        title, picture = f"[notebooks/{stem}.py](../../notebooks/{stem}.py)", f"notebooks/{stem}-light.png"
        assert 0 < text.find(title) < text.find(picture) < text.find(title) + 400


@pytest.mark.proof
def test_a_page_is_taken_in_both_themes(script: ModuleType, chromium: Browser, tmp_path: Path) -> None:
    script.make(["missions"], tmp_path, chromium)
    light, dark = (Image.open(tmp_path / f"missions-{theme}.png").convert("L") for theme in ("light", "dark"))
    assert light.size == dark.size == (script.WIDTH, script.HEIGHT)
    assert ImageStat.Stat(light).mean[0] > 200
    assert ImageStat.Stat(dark).mean[0] < 60
    tracks = (340, 210, 1420, 360)
    for picture in (light, dark):  # the tracks of three missions are drawn
        assert ImageStat.Stat(picture.crop(tracks)).stddev[0] > 8

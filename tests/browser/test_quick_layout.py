"""What the page's script spares the browser: styles that are read or written without need, and layouts."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page

from tests.browser.conftest import IDLE, wait_for

pytestmark = pytest.mark.browser

HOSTS = """
const hosts = [], search = (root) => {
  for (const element of root.querySelectorAll("*")) {
    if (element.shadowRoot) { hosts.push(element); search(element.shadowRoot); }
  }
};
search(document);
"""

VARIABLES = f"""
() => {{
  {HOSTS}
  const sheets = [document, ...hosts.map((host) => host.shadowRoot)].flatMap((root) => [...root.styleSheets]);
  const rules = sheets.flatMap((sheet) => [...sheet.cssRules]).map((rule) => rule.cssText);
  const styles = hosts.map((host) => host.style.cssText);
  return [rules.length, [...rules, ...styles].filter((css) => /--bk-/.test(css))];
}}
"""

COUNTED = f"""
async (act) => {{
  {HOSTS}
  const [root] = Bokeh.index.roots, {{LayoutDOMView}} = Bokeh.require("models/layouts/layout_dom");
  const content = Object.getOwnPropertyDescriptor(Node.prototype, "textContent");
  const measure = LayoutDOMView.prototype.measure_layout, ask = window.getComputedStyle;
  const counts = {{asked: 0, written: 0, layouts: 0}};
  window.getComputedStyle = (...given) => {{ counts.asked += 1; return ask(...given); }};
  Object.defineProperty(Node.prototype, "textContent", {{...content, set(text) {{
    if (this instanceof HTMLStyleElement) counts.written += 1;
    content.set.call(this, text);
  }}}});
  LayoutDOMView.prototype.measure_layout = function() {{
    if (this === root) counts.layouts += 1;
    measure.call(this);
  }};
  const fields = hosts.filter((host) => host.shadowRoot.querySelector(".text-input"));
  if (act === "layout") root.invalidate_layout();
  else for (const field of fields) field.style.minHeight = act;
  for (let frame = 0; frame < 4; frame++) await new Promise(requestAnimationFrame);
  LayoutDOMView.prototype.measure_layout = measure;
  Object.defineProperty(Node.prototype, "textContent", content);
  window.getComputedStyle = ask;
  return {{...counts, fields: fields.length, components: hosts.length}};
}}
"""
"""Lays the page out anew, or gives all fields for text another least height; counts what follows."""


@pytest.mark.proof
def test_no_style_of_the_page_is_one_that_the_plots_no_longer_read(shared_page: Page) -> None:
    rules, found = shared_page.evaluate(VARIABLES)
    assert rules > 1000
    assert found == []


def test_a_layout_writes_only_styles_that_change(shared_page: Page) -> None:
    wait_for(shared_page, IDLE)
    counts = shared_page.evaluate(COUNTED, "layout")
    layouts, components = (
        counts["layouts"],
        counts["components"],
    )  # a busy browser may still have a layout to do
    assert layouts >= 1
    assert components > 200
    assert counts["written"] < components / 10 * layouts  # Bokeh alone writes each style twice
    assert counts["asked"] < components / 4 * layouts  # Bokeh alone asks each component three times


def test_components_that_change_their_size_share_a_layout(shared_page: Page) -> None:
    counts = shared_page.evaluate(COUNTED, "90px")
    assert counts["fields"] >= 10
    assert 1 <= counts["layouts"] <= counts["fields"] / 3  # Bokeh alone lays the page out for each
    shared_page.evaluate(COUNTED, "")
    wait_for(shared_page, IDLE)


MADE = """
async () => {
  const [root] = Bokeh.index.roots, {LayoutDOMView} = Bokeh.require("models/layouts/layout_dom");
  const measure = LayoutDOMView.prototype.measure_layout, document = Bokeh.documents[0];
  let layouts = 0;
  LayoutDOMView.prototype.measure_layout = function() {
    if (this === root) layouts += 1;
    measure.call(this);
  };
  Object.defineProperty(document, "is_idle", {configurable: true, value: false});
  for (let part = 0; part < 20; part++) root.compute_layout();
  const at_once = layouts;
  await new Promise((resolve) => setTimeout(() => requestIdleCallback(resolve), 300));
  delete document.is_idle;
  LayoutDOMView.prototype.measure_layout = measure;
  return [at_once, layouts];
}
"""
"""Asks for twenty layouts of a page that is still made; counts those at once, and all."""


def test_the_parts_of_a_page_that_is_made_share_a_layout(shared_page: Page) -> None:
    wait_for(shared_page, IDLE)
    at_once, layouts = shared_page.evaluate(MADE)
    assert at_once == 0
    assert 1 <= layouts <= 4  # a busy browser may still have one of its own to do


FILES = """
performance.getEntriesByType("resource").map((file) => new URL(file.name).pathname.split("/").pop())
"""


def test_a_page_loads_the_code_of_its_components_once_and_none_that_it_does_not_need(
    shared_page: Page,
) -> None:
    files = shared_page.evaluate(FILES)
    assert files.count("panel-material-ui.bundle.js") == 1
    link, begun = shared_page.evaluate(
        """() => {
          const bundle = (one) => one.name.includes("/panel-material-ui.bundle.js");
          const found = performance.getEntriesByType("resource").find(bundle);
          return [document.querySelector("link[rel=modulepreload]").href === found.name, found.startTime];
        }"""
    )
    assert link
    assert begun < shared_page.evaluate(
        "performance.getEntriesByType('navigation')[0].domContentLoadedEventStart"
    )
    assert not {"es-module-shims.min.js", "bokeh-gl.min.js"} & set(files)


CLASSES = """
async () => {
  const {resolver} = Bokeh.documents[0], here = (name) => [...resolver._known_models.keys()].includes(name);
  const waiting = [...resolver.described.keys()], name = waiting.find((one) => one.startsWith("DatePicker"));
  const begun = [resolver._known_models.size, waiting.length, here(name)];
  const made = new (resolver.get(name))({value: "2026-01-02"});
  const again = resolver.get(name) === made.constructor;
  return [...begun, here(name), made.value, again, resolver.get("NoSuchKind")];
}
"""
"""Counts the classes of components that are made, and makes one more."""


def test_a_page_makes_the_classes_of_the_components_that_it_has(shared_page: Page) -> None:
    made, described, was_there, is_there, value, is_same, none = shared_page.evaluate(CLASSES)
    assert 10 < made < described
    assert (was_there, is_there, value, is_same, none) == (False, True, "2026-01-02", True, None)

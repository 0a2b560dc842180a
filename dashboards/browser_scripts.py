"""Browser scripts: what a page does by itself when it opens, and when its connection is lost."""

from __future__ import annotations

import json

from bokeh.document import Document
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.models.callbacks import CustomJS

from dashboards.page_tabs import TABS
from dashboards.pages.base import NARROW
from dashboards.upload import SAME_FILE_AGAIN
from dashboards.verdict_chip import LOOK
from dashboards.widgets import SETTING

PAPER = 1040
"""Widest page that browsers make small enough for upright paper [px]."""

CUT_UPLOAD = "ins-lab-cut-upload"
"""Name under which a browser stores which files had not arrived when the connection was lost."""

LOST = (
    f"""
const CUT_UPLOAD = "{CUT_UPLOAD}";"""
    + """
const id = "ins-lab-lost-connection";
const TRIES = "ins-lab-tries";
const [FIRST, LONGEST, OFTEN] = [1000, 60000, 120000];
const restarts = window.insLabClosed === 1012;

// A page that is lost again soon after it came back waits longer. Those of a class do not ask all at once.
const tries = () => {
  try {
    const [count, last] = JSON.parse(window.sessionStorage.getItem(TRIES)) ?? [0, 0];
    return Date.now() - last < OFTEN ? count : 0;
  } catch {
    return 0;
  }
};
const pause = (count) => Math.min(FIRST * 2 ** count, LONGEST) * (0.5 + Math.random());
const come_back = async (count) => {
  for (let asked = 0; ; asked += 1) {
    await new Promise((done) => setTimeout(done, pause(Math.min(count + Math.max(asked - 20, 0), 6))));
    try {
      const health = new URL("health" + window.location.search, document.baseURI);
      const answer = await fetch(health, {cache: "no-store", redirect: "manual"});
      if (answer.status < 500) break;
    } catch {
      // nobody answers yet
    }
  }
  try {
    window.sessionStorage.setItem(TRIES, JSON.stringify([count + 1, Date.now()]));
  } catch {
    // a browser that stores nothing does not count
  }
  window.location.reload();
};

if (document.getElementById(id) === null) {
  const box = window.insLabAlert(
    (restarts ? "The server restarts. " : "The connection to the server is lost. ")
    + "This page comes back by itself once the server answers, with its settings, its tab and "
    + "the solved steps of lessons.");
  box.id = id;
  const buttons = Array.from(Bokeh.index.query(() => true), (view) => view.shadow_el?.querySelector("label"));
  const is_sending = (one) => one?.querySelector("[type=file]") && one.querySelector("[role=progressbar]");
  const sending = buttons.find(is_sending);
  if (sending) window.sessionStorage.setItem(CUT_UPLOAD, sending.innerText.trim().replace(/^\\S+ /, ""));
  come_back(tries());
}
"""
)
"""Says so above all else; loads the page again once a server answers.

A server discards a page without a connection, so only a new one reacts. A server without the address
``health``, as that of ``panel serve``, answers that there is none.
"""

PRINT = f"""
const page = document.documentElement.style;
const sizes = ["width", "height", "zoom", "columns"].map((name) => `--print-${{name}}`);
window.addEventListener("beforeprint", () => {{
  const roots = Array.from(Bokeh.index.roots, (view) => view.shadow_el?.querySelector(".main-content"));
  const width = roots.find((found) => found)?.clientWidth;
  if (!width) return;
  const columns = width <= {NARROW} ? "minmax(0, 1fr)" : "";
  const values = [`${{width}}px`, `${{window.innerHeight}}px`, Math.min(1, {PAPER} / width), columns];
  sizes.forEach((name, index) => page.setProperty(name, values[index]));
}});
window.addEventListener("afterprint", () => sizes.forEach((name) => page.removeProperty(name)));
"""
"""Prints a page as large as it is: a browser paints no plot anew for paper, but makes the page smaller."""


READY = f"""
window.insLabReady = true;
window.dispatchEvent(new Event("ins-lab-ready"));
const lost = window.sessionStorage.getItem("{CUT_UPLOAD}");
window.sessionStorage.removeItem("{CUT_UPLOAD}");
if (lost) {{
  const words = `The connection was lost before the upload of ${{lost}} was complete. Please upload again.`;
  window.insLabAlert(words, "Close", (box) => box.remove());
}}
"""
"""Says that the server hears of changes from now on, see ``history_bar.js``, and which upload was cut."""

COVER = (
    f"""
const TABS = {json.dumps([[(page.title, page.contents) for page in pages] for pages in TABS.values()])};
"""
    + """
const models = [...Bokeh.documents[0].all_models];
const stage = models.find((one) => one.name === "page stage");
const tabs = models.find((one) => one.data?.name === "page tabs").data;
const parts = models.find((one) => one.css_classes?.includes?.("page-parts"));
const view_of = (wanted) => Array.from(Bokeh.index.query(({model}) => model === wanted))[0];
const last = TABS.map(([[title]]) => title);  // the part of each tab that was open last
const frame = document.createElement("div");
frame.className = "frame";
frame.setAttribute("role", "status");
frame.innerHTML = "<h2></h2><p></p><div class='bar' role='progressbar' aria-label='Progress'></div>"
  + "<button type='button'>Cancel</button>";
const [name, words, , cancel] = frame.children;
const is_in = (tab, title) => TABS[tab]?.some(([one]) => one === title);
const tab_of = (title) => TABS.findIndex((_pages, tab) => is_in(tab, title));
const wanted = () => (is_in(tabs.active, parts.data.value) ? parts.data.value : last[tabs.active]);
const view = view_of(stage), {update_children} = view;
let root = view;
while (root.parent) root = root.parent;
const {invalidate_layout} = root;
let is_making = false, is_stale = false;
let [made] = stage.tags;  // the page that the browser has made
const update = () => {
  const [there] = stage.tags, title = wanted(), {el, shadow_el} = view, waits = title !== made;
  if (tab_of(there) >= 0) last[tab_of(there)] = there;
  view_of(parts).el.style.visibility = waits && !is_in(tabs.active, parts.data.value) ? "hidden" : "";
  el.toggleAttribute("data-waiting", waits);
  for (const part of shadow_el.children) part.classList.toggle("covered", waits && part !== frame);
  if (!waits) {
    frame.remove();
    if (is_stale) root.invalidate_layout();
    return;
  }
  name.textContent = title;
  words.textContent = `Drawing ${Object.fromEntries(TABS[tabs.active])[title]} …`;
  cancel.title = `Back to ${made}`;
  cancel.hidden = !made;
  frame.style.top = `${el.scrollTop}px`;
  if (!frame.isConnected) shadow_el.append(frame);
  if (title === there) view.update_children();
};
cancel.addEventListener("click", () => {
  const tab = tab_of(made);
  if (tabs.active === tab) parts.data.value = made;
  else tabs.active = tab;
});

// Each change of a size, or of what is seen, has the whole page laid out. One that is covered is not: the
// layout of the next page is that of these changes, too.
root.invalidate_layout = () => {
  is_stale = view.el.hasAttribute("data-waiting") && !is_making;
  if (!is_stale) invalidate_layout.call(root);
};

// A page that has come is made once the browser has painted what covers the other, in a turn of its own: keys
// and clicks before it may have left it again.
const painted = (call) => {
  if (document.hidden) setTimeout(call);
  else requestAnimationFrame(() => setTimeout(call));
};
let is_due = false, making = Promise.resolve();
const make = async () => {
  await new Promise(painted);
  is_due = false;
  const [there] = stage.tags;
  if (there !== wanted()) {
    if (there === made) made = "";  // it has changed, and is made again once one comes back
    return;
  }
  is_making = true;
  try {
    await update_children.call(view);
  } finally {
    is_making = false;
  }
  made = there;
  update();
};
view.update_children = () => {
  if (!is_due) making = making.then(make).catch((error) => console.error(error));
  is_due = true;
};
window.insLabTurn = (number) => { if (number <= TABS.length) tabs.active = number - 1; };
for (const changed of [tabs.properties.active, parts.data.properties.value, stage.properties.tags]) {
  changed.change.connect(update);
}
update();
"""
)
"""Covers the page that one leaves at once, with what comes, until the next page is there: the server may be
at work. A page that is left before it comes is not made.

The server tells the title of the page that it lays out before the page itself.
"""

STALE = f"""
const bokeh = Bokeh.documents[0];
const all = () => [...bokeh.all_models];
const chip = all().find((one) => one.css_classes?.includes?.("verdict-chip"));
const {{data: bar}} = all().find((one) => "answered" in (one.data?.attributes ?? {{}}));
const settings = new WeakMap();
const tagsOf = (part) => {{
  if (!settings.has(part)) {{
    const of = (one) => (one === part || one.data === part) && one.tags?.includes?.("{SETTING}");
    settings.set(part, all().find(of)?.tags);
  }}
  return settings.get(part);
}};
const unheard = window.insLabUnheard = new Map();
const walks = () => ["undo", "redo", "visit"].includes(bar.asked.at(-1)?.[1]);
const age = (is_old) => {{
  const shown = Bokeh.index.query((view) => view.model === chip);
  for (const {{el}} of shown) el.toggleAttribute("data-old", is_old);
}};
const is_drawn = () => Bokeh.index.query((view) => view.model === chip).every(({{shadow_el}}) => {{
  const button = shadow_el.querySelector("button");
  return !button || getComputedStyle(button).getPropertyValue("{LOOK}") === chip.data.sx["{LOOK}"];
}});
let sent = 0, repeats = false;
bokeh.on_change(({{model, attr, value, sync, msg_data}}) => {{
  const part = msg_data?.origin ?? (["value", "asked"].includes(attr) ? model : null);
  if (!part || !(part === bar ? walks() : tagsOf(part))) return;
  const [, path, name] = tagsOf(part) ?? [];
  const key = `${{path}} ${{name}}`, mine = unheard.get(key);
  if (!sync) {{
    if (attr === "value" && mine?.question > bar.answered) mine.crossed = !mine.repeated;
    return;
  }}
  age(true);
  const question = ++sent;
  if (name && attr === "value") {{
    unheard.delete(key);
    unheard.set(key, {{change: [path, name, value], question, part, repeated: repeats}});
  }}
  queueMicrotask(() => {{ bar.question = question }});
}});
bar.properties.answered.change.connect(() => {{
  if (bar.answered !== sent) return;
  const settle = () => {{
    if (bar.answered !== sent) return;
    if (is_drawn()) age(false);
    else requestAnimationFrame(settle);
  }};
  settle();
  repeats = true;
  for (const {{change: [, , value], part, crossed}} of [...unheard.values()]) {{
    if (crossed) part.setv("value_input" in part.attributes ? {{value, value_input: value}} : {{value}});
  }}
  repeats = false;
}});
bar.properties.shown.change.connect(() => {{
  for (const [key, {{question}}] of unheard) if (question <= bar.answered) unheard.delete(key);
}});
"""
"""Makes the verdict grey as soon as what may begin a run is on its way to the server, until it is heard.

That is a setting, a button that changes some, and a step in the history. What the server has not written into
the address yet is noted, for the page that comes back after a cut connection.

A component is drawn some time after it has changed: on a busy machine, several frames later. The chip is grey
until it has the look that the server gave it.

The server answers in the order in which it is asked. What it says of a field before it has heard what was
entered there meanwhile is older, and would stay in the field: what was entered is put there again, once.
"""


def add_browser_scripts(document: Document) -> None:
    """Add the scripts to the document of a page."""
    document.js_on_event(DocumentReady, CustomJS(code=SAME_FILE_AGAIN + COVER + STALE + PRINT + READY))
    document.js_on_event(ConnectionLost, CustomJS(code=LOST))

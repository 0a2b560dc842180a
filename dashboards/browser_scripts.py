"""Browser scripts: what a page does by itself when it opens, and when its connection is lost."""

from __future__ import annotations

from bokeh.document import Document
from bokeh.events import ConnectionLost, DocumentReady
from bokeh.models.callbacks import CustomJS

from dashboards.pages.base import NARROW
from dashboards.upload import SAME_FILE_AGAIN
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

COVER = """
const models = [...Bokeh.documents[0].all_models];
const stage = models.find((one) => one.name === "page stage");
const tabs = models.find((one) => one.data?.name === "page tabs");
const parts = models.find((one) => one.css_classes?.includes?.("page-parts"));
const place_of = (wanted) => Array.from(Bokeh.index.query(({model}) => model === wanted))[0].el;
const cover = (...left) => {
  const el = place_of(stage);
  const {change} = stage.properties.children;
  const show = (visibility) => { for (const one of left) place_of(one).style.visibility = visibility; };
  const arrive = () => { change.disconnect(arrive); delete el.dataset.waiting; show(""); };
  el.dataset.waiting = "Drawing …";
  show("hidden");
  change.connect(arrive);
};
tabs.data.properties.active.change.connect(() => cover(parts));
parts.data.properties.value.change.connect(() => cover());
"""
"""Covers the page that one leaves at once, with the parts of its tab, until the next one comes: the server
may be at work."""

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
  const settle = () => {{ if (bar.answered === sent) age(false) }};  // once the chip is painted anew
  requestAnimationFrame(() => requestAnimationFrame(settle));
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

The server answers in the order in which it is asked. What it says of a field before it has heard what was
entered there meanwhile is older, and would stay in the field: what was entered is put there again, once.
"""


def add_browser_scripts(document: Document) -> None:
    """Add the scripts to the document of a page."""
    document.js_on_event(DocumentReady, CustomJS(code=SAME_FILE_AGAIN + COVER + STALE + PRINT + READY))
    document.js_on_event(ConnectionLost, CustomJS(code=LOST))

// Private parts of Bokeh and Panel in the browser that the laboratory replaces: an opening computed all styles of
// the page two thousand times, and laid all of it out 140 times. This script runs before the page is made.
{
  const {InlineStyleSheet} = Bokeh.require("core/dom");
  const {VisualProperties} = Bokeh.require("core/visuals/visual");
  const {LayoutDOMView} = Bokeh.require("models/layouts/layout_dom");
  const {PlotView} = Bokeh.require("models/plots/plot_canvas");

  const original = (kind, name) => {
    const found = Object.getOwnPropertyDescriptor(kind.prototype, name);
    if (found === undefined) { throw new Error(`this version of Bokeh has no ${kind.name}.${name}`); }
    return found.value ?? found.get;
  };

  // Bokeh does not say with which code a server closed the connection (browser_scripts.py).
  const {ClientConnection} = Bokeh.require("client/connection");
  const on_close = original(ClientConnection, "_on_close");
  ClientConnection.prototype._on_close = function(event, reject) {
    window.insLabClosed = event.code;
    on_close.call(this, event, reject);
  };

  // A page begins with the theme of the reader's system unless its address names one, and without the settings where
  // they would take the room of the plots. Once it is made, another theme takes seconds, and letters are dark on dark.
  const connection = Bokeh.require("client/connection");
  const {pull_session} = connection;
  connection.pull_session = async (...session) => {
    const pulled = await pull_session(...session).catch((error) => {
      window.insLabAlert(`This page cannot connect to its server. If you opened it long ago, load it again. If that
        does not help, open it by the address that the server printed; to open it as ${window.location.host}, whoever
        serves it starts it with: ins-lab serve --origin ${window.location.host}`);
      throw error;
    });
    const frame = pulled.document.roots().find((root) => root.data?.dark_theme !== undefined)?.data;
    const {theme} = Object.fromEntries(new URLSearchParams(window.location.search));
    if (frame && theme === undefined && window.matchMedia("(prefers-color-scheme: dark)").matches) {
      for (const {data} of pulled.document.all_models) {  // each component has its own
        if (data?.attributes?.dark_theme === false) { data.setv({dark_theme: true}, {sync: data === frame}); }
      }
    }
    const narrow = window.matchMedia("(max-width: 1099.95px)");
    let was_open = false;
    if (frame && narrow.matches) { frame.sidebar_open = false; }
    narrow.addEventListener("change", () => {
      if (narrow.matches) { was_open = frame.sidebar_open; }
      frame.sidebar_open = was_open && !narrow.matches;
    });
    watch_silence(pulled._connection, () => pulled.request_server_info());
    return pulled;
  };

  // A network that swallows packets closes no connection. The server answers each message, so one without an answer is
  // noticed; a page that says nothing asks now and then. Only the time counts in which this page was awake and seen: a
  // browser that slept, or was at work itself, has heard nothing either. A large message may take its time on its way.
  const [LOOK, MOST, OFTEN, SLOWEST] = [500, 4000, 10000, 50];  // [ms], and bytes each ms
  const watch_silence = (connection, ask) => {
    let asked = false, sent = 0, waited = 0, quiet = 0, looked = performance.now(), box = null, socket = null;
    const end = () => {
      asked = false;
      sent = waited = quiet = 0;
      box?.remove();
      box = null;
    };
    const follow = () => {
      if (socket === connection.socket) { return; }
      ({socket} = connection);
      end();
      if (socket === null) { return; }
      const {send} = socket;
      socket.addEventListener("message", end);
      socket.send = (data) => {
        asked = true;
        sent += data.byteLength ?? data.length;
        send.call(socket, data);
      };
    };
    follow();
    setInterval(() => {
      const now = performance.now(), passed = now - looked;
      looked = now;
      follow();
      if (socket === null) { return; }
      if (document.hidden || passed > MOST) {
        waited = 0;
        quiet = OFTEN;
        return;
      }
      quiet += LOOK;
      if (asked) { waited += LOOK; } else if (quiet >= OFTEN) { ask().catch(() => {}); }
      if (waited < MOST + sent / SLOWEST || box !== null) { return; }
      box = window.insLabAlert(`The server does not answer. It is busy, or the network is interrupted. What you do
        meanwhile is done once it answers.`, "Hide", (shown) => { shown.style.display = "none"; });
      box.setAttribute("role", "status");
      Object.assign(box.style, {  // over plots only: tabs, settings and the time go on in the browser itself
        background: "#6b4a00", top: "auto", left: "auto", right: "12px", bottom: "84px", borderRadius: "6px",
        width: "min(440px, 92vw)", boxSizing: "border-box",
      });
    }, LOOK);
  };

  // The server describes each component that it knows, 160 of them, before the page, which has 20. Bokeh makes a class of
  // each at once; here a class is made once something is of it.
  const {Deserializer} = Bokeh.require("core/serialization/deserializer");
  const {ModelResolver} = Bokeh.require("core/resolvers");
  const decode = original(Deserializer, "decode");
  Deserializer.prototype.decode = function(part, buffers) {
    if (!Array.isArray(part) || part[0]?.type !== "model") { return decode.call(this, part, buffers); }
    this.resolver.described = new Map(part.map((kind) => [kind.name, () => decode.call(this, kind, buffers)]));
    return [];
  };
  const find_class = original(ModelResolver, "get");
  ModelResolver.prototype.get = function(name) {
    const make = this.described?.get(name);
    this.described?.delete(name);
    make?.();
    return find_class.call(this, name);
  };

  // Bokeh asks the browser for a variable --bk-… for each colour, width and font of each part of a plot, at every
  // repaint. No style sheet of the laboratory sets one.
  original(VisualProperties, "_get_css_value");
  VisualProperties.prototype._get_css_value = () => "";

  // Bokeh writes style sheets again that do not change, and empties them first. Inside a layout the text is only
  // remembered; at its end, what differs is written.
  const texts = new Map();
  let depth = 0;
  const write = (sheet, css) => { if (sheet.el.textContent !== css) { sheet.el.textContent = css; } };
  original(InlineStyleSheet, "_update");
  InlineStyleSheet.prototype._update = function(css) {
    if (depth > 0) { texts.set(this, css); } else { write(this, css); }
  };
  const css = original(InlineStyleSheet, "css");
  Object.defineProperty(InlineStyleSheet.prototype, "css", {
    configurable: true,
    get() { return texts.get(this) ?? css.call(this); },
  });
  for (const name of ["update_layout", "measure_layout"]) {
    const lay_out = original(LayoutDOMView, name);
    LayoutDOMView.prototype[name] = function() {
      depth += 1;
      try {
        lay_out.call(this);
      } finally {
        depth -= 1;
        if (depth === 0) {
          for (const [sheet, text] of texts) { write(sheet, text); }
          texts.clear();
        }
      }
    };
  }

  // The size of letters from which relative ones are computed: it stays the same for a plot.
  const sizes = new WeakMap();
  const base_font_size = original(PlotView, "base_font_size");
  Object.defineProperty(PlotView.prototype, "base_font_size", {
    configurable: true,
    get() {
      if (!sizes.has(this) && this.el.isConnected) { sizes.set(this, base_font_size.call(this)); }
      return sizes.get(this) ?? base_font_size.call(this);
    },
  });

  // Bokeh clips glyphs to the frame of their plot, but for those in the overlay, where the curves of a stream are.
  const {GlyphRendererView} = Bokeh.require("models/renderers/glyph_renderer");
  Object.defineProperty(GlyphRendererView.prototype, "needs_clip", {configurable: true, get: () => true});

  // At each repaint, Bokeh writes a style sheet that moves an empty element over the extent of each curve. The next
  // text of a plot then had the styles of the page computed anew, eighteen times for a step of a slider.
  original(Bokeh.require("models/renderers/renderer").RendererView, "update_position");
  GlyphRendererView.prototype.update_position = function() { this.el.style.display = "none"; };

  // One finger scrolls the page; across a plot that shows a stretch of time, as after a pinch, it moves along the time.
  // To Bokeh, it would drag a box, as a mouse does: Bokeh hears of a finger that moves only when there is another one.
  const SLOP = 8;  // a finger that moves less has not moved [px]
  function follow_finger(view) {
    const {model: {x_range}, canvas: {events_el}} = view, fingers = new Set();
    let from = null;
    // A browser reads `touch-action` when a finger comes down, so it always follows the stretch that is shown.
    const touch = () => {
      const [first, last] = x_range.computed_bounds ?? x_range.bounds ?? [-Infinity, Infinity];
      const is_part = x_range.start > first || x_range.end < last;
      events_el.style.touchAction = is_part ? "pan-y" : "pan-x pan-y";
      return is_part ? [first, last] : null;
    };
    view.on_change([x_range.properties.start, x_range.properties.end], touch);
    touch();
    view.el.addEventListener("pointerdown", ({pointerType, pointerId, clientX}) => {
      if (pointerType !== "touch") { return; }
      // Two fingers pinch, which Bokeh does by itself.
      fingers.add(pointerId);
      from = fingers.size === 1 && touch() ? {x: clientX, start: x_range.start, end: x_range.end, moves: false} : null;
    }, true);
    view.el.addEventListener("pointermove", (event) => {
      const {pointerType, clientX} = event;
      if (pointerType !== "touch" || fingers.size > 1) { return; }
      event.stopPropagation();
      // The event is stopped even so: Bokeh must not see a single finger that moves.
      if (from === null) { return; }
      from.moves ||= Math.abs(clientX - from.x) > SLOP;
      if (!from.moves) { return; }
      const [first, last] = touch() ?? [from.start, from.end];
      const wanted = (from.x - clientX) / view.frame.bbox.width * (from.end - from.start);
      const by = Math.min(Math.max(wanted, first - from.start), last - from.end);
      x_range.setv({start: from.start + by, end: from.end + by});
    }, true);
    for (const kind of ["pointerup", "pointercancel"]) {
      view.el.addEventListener(kind, (event) => {
        const {pointerId} = event;
        if (from?.moves) {  // it was no tap
          from = null;
          event.stopPropagation();
          // Bokeh has seen the finger come down, and must not wait for its end, which would count as a tap.
          events_el.dispatchEvent(new PointerEvent("pointercancel", {pointerId}));
        }
        from = null;
        fingers.delete(pointerId);
      }, true);
    }
  }

  // Bokeh has no list of the plots of a page, for what all plots share (plot_tools.js).
  const plots = window.insLabPlots = new Set();
  const render_plot = original(PlotView, "render");
  PlotView.prototype.render = function() {
    render_plot.call(this);
    if (!plots.has(this) && this.model.x_range?.name === "time axis") { follow_finger(this); }
    plots.add(this);
    plots.added?.(this);
  };
  const remove_plot = original(PlotView, "remove");
  PlotView.prototype.remove = function() {
    plots.delete(this);
    plots.changed?.();
    remove_plot.call(this);
  };

  // Each component that changes its size has the whole page laid out. A plot needs that at once; the others
  // share one layout in the next frame, because the browser itself has placed them. While a page is made, each of its
  // parts has it laid out again, too: they share a layout once the browser has made what it could.
  const waiting = new Set();
  const after_resize = original(LayoutDOMView, "_after_resize");
  const root_of = (view) => view.is_managed ? root_of(view.parent) : view;
  const lay_out_soon = (root, call) => {
    if (waiting.has(root)) { return; }
    waiting.add(root);
    call(() => {
      waiting.delete(root);
      if (!root.el.isConnected) { return; }
      if (root instanceof ESMView) { lay_out_root.call(root); } else { root.compute_layout(); }
    });
  };
  const once_made = (call) => {
    if (window.requestIdleCallback) { requestIdleCallback(call, {timeout: 150}); } else { setTimeout(call, 50); }
  };
  LayoutDOMView.prototype._after_resize = function() {
    const root = root_of(this);
    if (this instanceof PlotView || !root._layout_computed) {
      after_resize.call(this);
    } else {
      lay_out_soon(root, is_made(root) ? requestAnimationFrame : once_made);
    }
  };
  const ReactiveESM = Bokeh.Models.get("panel.models.esm.ReactiveESM");
  const ESMView = ReactiveESM.prototype.default_view;
  const lay_out_root = original(ESMView, "compute_layout");
  const is_made = (root) => !(root instanceof ESMView) || root.model.document?.is_idle !== false;
  ESMView.prototype.compute_layout = function() {
    if (this.is_managed || !this._layout_computed || is_made(this)) {
      lay_out_root.call(this);
    } else {
      lay_out_soon(this, once_made);
    }
  };

  // Panel compiles the code of each component from TypeScript, again for each one of a kind. That of the laboratory is
  // plain JavaScript. It is imported by the browser itself, which keeps what it has compiled.
  original(ReactiveESM, "compile");
  ReactiveESM.prototype.compile = function() { return this.esm; };
  window.importShim = (address) => import(new URL(address, document.baseURI));
  window.importShim.addImportMap = () => {};  // bundles import nothing

  // A component writes what the server tells it back a moment later. In a slow browser a newer value may have come
  // meanwhile: it was undone, and with it the position of a slider. A component writes what it sets itself.
  const ReactComponent = Bokeh.Models.get("panel.models.esm.ReactComponent");
  const code_of = original(ReactComponent, "_render_code");
  const replace = (code, old, by) => {
    if (!code.includes(old)) { throw new Error(`this version of Panel has no ${old}`); }
    return code.replace(old, () => by);
  };
  ReactComponent.prototype._render_code = function() {
    const marking = `React.useCallback((given) => {
      initialized.current = !Object.is(given, targetModel.attributes[resolvedProp])
      setValue(given)
    }, [])`;
    const code = replace(code_of.call(this), "else { initialized.current = true }", "initialized.current = false");
    return replace(code, "return [value, setValue]", `return [value, ${marking}]`);
  };

  // Names for who hears the page: all cards unfold with "show more", a toggle gives its name to its icon, a tooltip
  // gives its text to an element that must have none, and headings leave out ranks.
  const name_parts = ({model: {class_name, data}, container}) => {
    if (class_name === "Card") {
      container.querySelector('[aria-label="show more"]')?.setAttribute("aria-label", data.title);
      container.querySelector("h6")?.setAttribute("aria-level", 2);
    }
    if (class_name === "Page") {
      container.querySelectorAll(".MuiToolbar-root > h5").forEach((spacer) => spacer.setAttribute("aria-hidden", true));
      container.querySelector("h3.title")?.setAttribute("aria-level", 1);
    }
    for (const hint of container.querySelectorAll(":is(span, div.MuiBox-root)[aria-label]:not([role])")) {
      const words = hint.getAttribute("aria-label");
      const toggled = hint.querySelector("input");
      const field = hint.closest(".MuiFormControl-root, .MuiFormControlLabel-root")
        ?.querySelector("input, textarea, [role=combobox]");
      toggled?.setAttribute("aria-label", words);
      if (!toggled) { field?.setAttribute("aria-description", words); }
      hint.removeAttribute("aria-label");
    }
  };
  const ReactComponentView = ReactComponent.prototype.default_view;
  const {after_rendered} = ReactComponentView.prototype;
  ReactComponentView.prototype.after_rendered = function(...given) {
    after_rendered.apply(this, given);
    if (!this.container) return;
    name_parts(this);
    if (this.model.class_name === "Page" && !this.renamed) {  // what it draws later has names, too
      this.renamed = new MutationObserver(() => name_parts(this));
      this.renamed.observe(this.container, {childList: true, subtree: true});
    }
  };
}

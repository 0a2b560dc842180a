// What all plots share: the legend, the values at the pointer or the time cursor, and a menu with pictures and numbers.
// All of it is read from the plots that the browser has; the server is asked for the samples of thinned curves alone.

const SIGMA = /^(±?)(\d+)σ$/  // of a length, the band has one side
const HELD = /^([A-D]): (.*)$/
const OUTSIDE = "outside ±3σ"
const MEANING = {"±3σ": "±3σ of the filter", "3σ": "±3σ of the filter", "95 %": "95 % of a right filter"}
const NOTHING = "–"
const plots = window.insLabPlots  // in which upstream.js notes them

const made = (kind, attributes = {}, ...content) => {
  const element = document.createElement(kind)
  for (const [name, text] of Object.entries(attributes)) element.setAttribute(name, text)
  element.append(...content)
  return element
}
const field = (spec) => spec?.field ?? (typeof spec === "string" ? spec : undefined)
const over_time = (view) => view.model.x_range?.name === "time axis"
const is_visible = (view) => view.el.isConnected && (view.el.checkVisibility?.({visibilityProperty: true}) ?? true)

const BETWEEN = "\u2009·\u2009"  // the parts of a title
const FINGERS = window.matchMedia("(hover: none)")
const DOTS_WIDTH = {mouse: 30, finger: 44}  // of the menu of a plot, which a mouse shows, with a gap beside it [px]
const EM = 13  // the size of letters to which those of a title are relative, in Bokeh [px]
const QUIET = 60  // without a repaint, plots are looked at again, for their legend and values [ms]
const POINTED = 250  // the same under a pointer, whose moves repaint all plots, on a slow computer a few times a second

const in_one_line = new WeakMap()  // titles of several lines: how they are written, and what they say
const words_of = ({title}) => (in_one_line.get(title)?.text === title?.text ? in_one_line.get(title)?.words : title.text)

function heading(view) {
  const [text] = (words_of(view.model) ?? "").split(BETWEEN)
  const [, name, unit] = /^(.*?)(?: \[([^\]]*)\])?(?:: zero)?$/.exec(text)
  return {name: name || "plot", unit: unit ?? ""}
}

// A title that is wider than its plot, or runs under the menu of the plot, continues in a second line, or in a third.
// Bokeh makes room for it only when the plot is laid out.
const ruler = document.createElement("canvas").getContext("2d")
function lines_of(words, room) {
  const [name, ...others] = words.split(BETWEEN), [first, ...rest] = name.split(/ (?!\[)/)
  const end = others.join(BETWEEN), said = ruler.measureText(end).width > room ? others : [end].filter(Boolean)
  const pieces = [...rest.map((word) => [" ", word]), ...said.map((one) => [BETWEEN, one])]
  const add = ([done, line], [joint, piece]) =>
    ruler.measureText(line + joint + piece).width > room ? [`${done}${line}\n`, piece] : [done, line + joint + piece]
  return pieces.reduce(add, ["", first]).join("")
}
function fit(view) {
  const {title} = view.model
  if (!title?.text || !view.frame?.bbox.width) return
  const [, number, unit] = /^([\d.]+)(.*)$/.exec(title.text_font_size) ?? [null, 13, "px"]
  ruler.font = `${title.text_font_style} ${unit === "em" ? number * EM : number}px ${title.text_font}`
  const words = words_of(view.model), room = view.bbox.width - view.frame.bbox.left
  const free = room - DOTS_WIDTH[FINGERS.matches ? "finger" : "mouse"]
  view.el.setAttribute("role", "figure")  // all that a reader of a canvas hears of it
  view.el.setAttribute("aria-label", words)
  const is_narrow = ruler.measureText(words).width > (FINGERS.matches ? free : room)
  const text = is_narrow ? lines_of(words, free) : words
  const place = view.renderer_views.get(title)?.layout
  if (text !== title.text) {
    in_one_line.set(title, {text, words})
    view.pause()  // or Bokeh paints a second line outside its canvas, before it makes room
    title.setv({text}, {sync: false})
    view.unpause(true)
  } else if (!place?.has_size_changed()) return
  view.request_layout(true)
}

function digits(value) {
  if (!Number.isFinite(value)) return NOTHING
  const size = Math.abs(value)
  const text = size >= 1000 ? value.toFixed(0) : size && size < 1e-3 ? value.toExponential(2) : value.toPrecision(3)
  return text.replace("-", "\u2212")
}

const curves_of = (view) => view.model.renderers.filter(({name, visible, glyph, data_source}) =>
  name && name !== OUTSIDE && visible && data_source && field(glyph.x) && field(glyph.y))
const band_of = (view) => view.model.renderers.find(({name, glyph}) => name && glyph && field(glyph.y1) && field(glyph.y2))

// The sample next to a time; NaN where there is none near.
function sample(source, x, time) {
  const times = source.data[x]
  const last = (times?.length ?? 0) - 1
  if (last < 0) return -1
  let low = 0, high = last
  while (high - low > 1) {
    const middle = (low + high) >> 1
    if (times[middle] <= time) low = middle
    else high = middle
  }
  const best = time - times[low] <= times[high] - time ? low : high
  // A mean step away: in a gap, and beyond the ends, there is no value.
  const far = last ? 1.01 * (times[last] - times[0]) / last : 1
  return Math.abs(times[best] - time) <= far ? best : -1
}

const read = (source, x, y, time) => source.data[y]?.[sample(source, x, time)] ?? NaN

// Each curve of a plot with its readers; what is held stands in the row of the same curve.
function rows_of(view) {
  const {name, unit} = heading(view)
  const band = band_of(view)
  const all = curves_of(view)
  const is_known = ({data_source, glyph}) => Array.prototype.some.call(data_source.data[field(glyph.y)] ?? [], Number.isFinite)
  const plain = all.filter((one) => !HELD.test(one.name))
  const known = plain.filter(is_known)
  const own = known.length ? known : plain  // a log has no reference; a stretch of time may have no fixes
  return own.toReversed().map((one) => {
    const reader = ({data_source, glyph}) => (time) => read(data_source, field(glyph.x), field(glyph.y), time)
    const edges = band && one === plain.at(-1)
      ? [band.glyph.y1, band.glyph.y2].map((y) => (time) => read(band.data_source, field(band.glyph.x), field(y), time))
      : null
    const held = Object.fromEntries(all.map((other) => [HELD.exec(other.name), other])
      .filter(([found]) => found?.[2] === one.name).map(([found, other]) => [found[1], reader(other)]))
    const label = own.length > 1 ? `${name}, ${one.name}` : name
    return {label, unit, held, value: reader(one), edges, factor: factor_of(band)}
  })
}

// The width of a band in σ; 0 for the interval of NEES and NIS.
function factor_of(band) {
  const [, sides, number] = SIGMA.exec(band?.name) ?? []
  return number ? (sides ? 2 : 1) * Number(number) : 0
}

function spread(row, time) {
  if (!row.edges) return ""
  const [low, high] = row.edges.map((edge) => edge(time))
  if (!Number.isFinite(low)) return NOTHING
  return row.factor ? digits((high - low) / row.factor) : `${digits(low)} to ${digits(high)}`
}

function save(blob, name, kind) {
  const link = made("a", {href: URL.createObjectURL(blob), download: `${name}.${kind}`})
  link.click()
  // Not at once: some browsers read the file only after the click has returned.
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000)
}

// The part of a picture that no plot paints: on the page, the ground is that of the page.
function ground(view) {
  // Each plot stands in shadow roots: the parent of a root is its host.
  for (let at = view.el; at; at = at.parentElement ?? at.getRootNode().host) {
    const colour = getComputedStyle(at).backgroundColor
    if (colour && !/, 0\)$|transparent/.test(colour)) return colour
  }
  return "#ffffff"
}

async function picture(view, kind, name) {
  const layer = view.export(kind, true)
  if (kind === "png") {
    const {ctx, canvas} = layer
    // Paints behind what is there already.
    ctx.globalCompositeOperation = "destination-over"
    ctx.fillStyle = ground(view)
    ctx.fillRect(0, 0, canvas.width, canvas.height)
    save(await layer.to_blob(), name, kind)
  } else {
    const svg = await (await layer.to_blob()).text()
    const back = `<rect width="100%" height="100%" fill="${ground(view)}"/>`
    save(new Blob([svg.replace(/(<svg[^>]*>)/, `$1${back}`)], {type: "image/svg+xml"}), name, kind)
  }
}

const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text)
const written = (value) => (typeof value === "number" ? (Number.isFinite(value) ? String(Number(value.toPrecision(7))) : "") : quoted(String(value)))

// The columns that a plot draws, in the stretch that is seen; rows of several sources share their abscissa.
function csv(view) {
  const {unit} = heading(view)
  const {start, end} = view.model.x_range
  const behind = unit ? ` [${unit}]` : ""
  const columns = []
  for (const {name, visible, glyph, data_source} of view.model.renderers) {
    const x = field(glyph?.x)
    if (!visible || !x || name === OUTSIDE || !data_source) continue
    for (const [y, suffix] of [[glyph.y, ""], [glyph.top, ""], [glyph.y1, " from"], [glyph.y2, " to"]]) {
      if (field(y)) columns.push({title: `${name ?? field(y)}${suffix}${behind}`, x, y: field(y), source: data_source})
    }
  }
  const rows = new Map()
  columns.forEach(({x, y, source}, index) => {
    const seen = new Map()  // how often a value of the abscissa has come, as of a path that returns
    const values = source.data[y] ?? []
    Array.from(source.data[x] ?? [], (at, place) => {
      if (typeof at === "number" && !(at >= Math.min(start, end) && at <= Math.max(start, end))) return
      const count = (seen.get(at) ?? 0) + 1
      seen.set(at, count)
      const key = `${at} ${count}`
      if (!rows.has(key)) rows.set(key, {at, cells: Array(columns.length).fill("")})
      rows.get(key).cells[index] = written(values[place])
    })
  })
  const first = over_time(view) ? "time [s]" : columns[0]?.x ?? "x"
  const sorted = over_time(view) ? [...rows.values()].sort((one, other) => one.at - other.at) : [...rows.values()]
  const head = [first, ...columns.map(({title}) => title)].map(quoted).join(",")
  return [head, ...sorted.map(({at, cells}) => [written(at), ...cells].join(","))].join("\r\n") + "\r\n"
}

// The address without what is of this person alone: the code of a class, and the theme.
function link() {
  const [path, query = ""] = window.location.href.split("#")[0].split("?")
  const kept = query.split("&").filter((part) => part && !/^(class|theme)=/.test(part))
  return kept.length ? `${path}?${kept.join("&")}` : path
}

// Return what is said of it: a browser may refuse its clipboard, and has none for an address without encryption.
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text)
    return "Link copied"
  } catch {
    const box = made("textarea", {}, text)
    document.body.append(box)
    box.select()
    const copied = document.execCommand("copy")
    box.remove()
    return copied ? "Link copied" : "The browser does not allow copying; Share shows the link"
  }
}

const ACTIONS = {
  "Picture (PNG)": (view, name) => picture(view, "png", name),
  "Drawing (SVG)": (view, name) => picture(view, "svg", name),
  "Numbers seen (csv)": (view, name, model) => {
    // Of a thinned curve, the browser has the extremes alone, and not when they were: the server writes its samples.
    if (!view.model.tags.includes("thinned")) return save(new Blob([csv(view)], {type: "text/csv"}), name, "csv")
    model.asked = {figure: view.model.id, name: `${name}.csv`, count: (model.asked.count ?? 0) + 1}
    return ""
  },
  "Copy link to this view": () => copy(link()),
}

const DOTS = new CSSStyleSheet()
DOTS.replaceSync(`
  .dots { position: absolute; top: 0; right: 0; width: 24px; height: 24px; padding: 0; border: 0; z-index: 10;
          border-radius: 4px; background: none; color: #7d8794; font: 700 17px/1 sans-serif; opacity: 0; cursor: pointer; }
  :host(:hover) .dots, .dots:focus-visible, .dots[aria-expanded=true] { opacity: 1; }
  .dots:hover { background: rgba(128, 128, 128, .18); }
  @media (hover: none) { .dots { opacity: 1; width: 36px; height: 30px; } }
  @media print { .dots { display: none; } }
`)

export function render({model}) {
  const all = made("button", {type: "button", class: "all", "aria-expanded": false, title: "Values of all curves (V)"}, "Values")
  const line = made("span", {class: "line"})
  const legend = made("span", {class: "legend", role: "group", "aria-label": "Legend"})
  const table = made("div", {class: "table", role: "table", "aria-label": "Values at the time cursor", hidden: ""})
  const menu = made("div", {class: "menu", role: "menu", popover: "auto"})
  const said = made("span", {class: "said", role: "status"})
  const root = made("div", {class: "tools"}, made("div", {class: "foot"}, all, line, said, legend), table, menu)

  let pointed = null, time = null  // the plot under the pointer, or the last one that was touched; and the time there
  let rows = [], cells = [], lines = new Map(), known = "", explained = "", due = false, of = null
  const cursor = () => model.document?.get_model_by_name("time cursor")

  const shown = () => [...plots].filter((view) => over_time(view) && is_visible(view))
    .map((view) => [view, view.el.getBoundingClientRect()])
    .sort(([, one], [, other]) => one.top - other.top || one.left - other.left).map(([view]) => view)

  // Which curves there are changes rarely: then table and legend are made anew.
  function look(views) {
    lines = new Map(views.map((view) => [view, rows_of(view)]))
    rows = [...lines.values()].flat()
    const letters = [...new Set(rows.flatMap(({held}) => Object.keys(held)))].sort()
    const now = JSON.stringify([letters, rows.map(({label, unit, edges}) => [label, unit, edges !== null])])
    if (now !== known) {
      known = now
      const heads = ["", "value", "σ or 95 %", ...letters, "unit"]
      const cell = (role, text) => made("span", {role}, text)
      table.style.setProperty("--columns", `minmax(0, 1fr) 66px 84px ${"66px ".repeat(letters.length)}40px`)
      table.replaceChildren(
        made("div", {role: "row", class: "head"}, ...heads.map((text) => cell("columnheader", text))))
      cells = rows.map((row) => {
        const parts = [cell("rowheader", row.label), ...heads.slice(1, -1).map(() => cell("cell", "")), cell("cell", row.unit)]
        table.append(made("div", {role: "row"}, ...parts))
        return {parts, letters}
      })
    }
    explain(views)
  }

  function explain(views) {
    const entries = new Map()
    for (const view of views) {
      const {center, above, right, below} = view.model
      const has_own = [...center, ...above, ...right, ...below].some((part) => part.type === "Legend")
      for (const one of view.model.renderers.toReversed()) {
        const {name, glyph, data_source} = one
        if (!name || !glyph || HELD.test(name) || (has_own && field(glyph.y) && name !== OUTSIDE)) continue
        const values = data_source.data[field(glyph.y) ?? field(glyph.y1)]
        const key = MEANING[name] ?? name
        if (!values || (!entries.has(key) && !Array.prototype.some.call(values, Number.isFinite))) continue
        const colour = glyph.line_color?.value ?? glyph.fill_color?.value ?? glyph.line_color ?? glyph.fill_color
        const kind = field(glyph.y1) ? "band" : glyph.type === "Scatter" ? "points"
          : (glyph.line_dash?.value ?? glyph.line_dash)?.length ? "dashed" : "curve"
        if (!entries.has(key)) entries.set(key, {kind, colours: new Set(), many: []})
        entries.get(key).colours.add(typeof colour === "string" ? colour : "currentColor")
        entries.get(key).many.push(one)
      }
    }
    const rank = (name) => [/^95|σ/.test(name), name === OUTSIDE].map(Number).join("")
    const sorted = [...entries].sort(([one], [other]) => rank(one).localeCompare(rank(other)))
    const outages = Boolean(model.document?.get_model_by_name("time without GPS")?.data.start.length)
    const now = JSON.stringify([outages, ...sorted.map(([name, {colours, many}]) =>
      [name, [...colours], many.map(({id, visible}) => [id, visible])])])
    if (now === explained) return
    explained = now
    legend.replaceChildren(...sorted.map(([name, {kind, colours, many}]) => {
      const seen = many.some(({visible}) => visible)
      const sample = made("i", {class: kind, style: `color: ${colours.size > 1 ? "inherit" : [...colours][0]}`})
      const entry = made("button", {type: "button", "aria-pressed": seen, title: seen ? "Hide" : "Show"}, sample, name)
      entry.addEventListener("click", () => {
        for (const one of many) one.visible = !seen
        again()
      })
      return entry
    }))
    if (outages) legend.append(made("span", {}, made("i", {class: "outage"}), "no GPS"))
  }

  function draw() {
    due = false
    if (!root.isConnected) return
    if (of === null) {
      of = shown()
      look(of)
      for (const view of plots) if (is_visible(view)) fit(view)
    }
    root.classList.toggle("empty", of.length === 0)
    const at = time ?? cursor()?.location ?? 0
    if (!table.hidden) {
      rows.forEach((row, index) => {
        const {parts, letters} = cells[index]
        const texts = [digits(row.value(at)), spread(row, at), ...letters.map((one) => (row.held[one] ? digits(row.held[one](at)) : ""))]
        texts.forEach((text, place) => {
          if (parts[place + 1].textContent !== text) parts[place + 1].textContent = text
        })
      })
      line.textContent = `at ${at.toFixed(2)} s${time === null ? "" : " (pointer)"}`
    } else if (pointed && lines.has(pointed)) {
      const words = lines.get(pointed).map((row) => {
        const {factor, unit, label} = row
        const beside = spread(row, at)
        return `${label} ${digits(row.value(at))}${unit && ` ${unit}`}${beside && (factor ? `, σ ${beside}` : `, 95 % ${beside}`)}`
      })
      line.textContent = `${at.toFixed(2)} s: ${words.join(" · ")}`
    } else {
      line.textContent = ""
    }
  }

  function ask() {
    if (!due) {
      due = true
      requestAnimationFrame(draw)
    }
  }
  // Plots come and go in groups, and their layout follows.
  let later = 0
  function again(quiet = QUIET) {
    clearTimeout(later)
    later = setTimeout(() => {
      of = null
      ask()
    }, quiet)
  }

  function toggle() {
    table.hidden = !table.hidden
    all.setAttribute("aria-expanded", !table.hidden)
    of = null
    ask()
  }

  function open(view, dots) {
    const {name} = heading(view)
    const close = () => {
      menu.hidePopover()
      dots.focus()
    }
    menu.setAttribute("aria-label", name)
    menu.replaceChildren(...Object.entries(ACTIONS).map(([words, act]) => {
      const item = made("button", {type: "button", role: "menuitem", tabindex: -1}, words)
      item.addEventListener("click", async () => {
        close()
        const told = await act(view, name.replaceAll(/[^\p{L}\p{N}]+/gu, "_").toLowerCase(), model)
        said.textContent = told ?? `${words} saved`
        setTimeout(() => { said.textContent = "" }, 3000)
      })
      return item
    }))
    const items = [...menu.children]
    menu.onkeydown = (event) => {
      const step = {ArrowDown: 1, ArrowUp: -1}[event.key]
      const from = items.findIndex((item) => item.matches(":focus"))
      if (step) items[(from + step + items.length) % items.length].focus()
      else if (event.key === "Tab" || event.key === "Escape") close()
      else return
      event.preventDefault()
    }
    menu.ontoggle = (event) => dots.setAttribute("aria-expanded", event.newState === "open")
    menu.showPopover()
    const place = dots.getBoundingClientRect()
    const {width, height} = menu.getBoundingClientRect()
    menu.style.left = `${Math.max(4, place.right - width)}px`
    menu.style.top = `${Math.max(4, Math.min(place.bottom, window.innerHeight - height - 4))}px`
    items[0].focus()
  }

  function equip(view) {
    const {shadow_el, el} = view
    if (!shadow_el.adoptedStyleSheets.includes(DOTS)) {
      shadow_el.adoptedStyleSheets = [...shadow_el.adoptedStyleSheets, DOTS]
      el.addEventListener("pointermove", (event) => {
        if (event.pointerType === "touch" || !over_time(view)) return
        pointed = view
        time = view.frame.x_scale.invert(event.clientX - el.getBoundingClientRect().left)
        ask()
      })
      el.addEventListener("pointerleave", (event) => {
        if (event.pointerType === "touch") return
        pointed = time = null
        ask()
      })
      view.repainted.connect(() => {  // with new data, or with another cursor
        ask()
        again(time === null ? QUIET : POINTED)
      })
      el.addEventListener("pointerdown", (event) => {
        if (event.pointerType === "touch") pointed = view
      })
    }
    const dots = made("button", {type: "button", class: "dots", "aria-haspopup": "menu", "aria-expanded": false,
                                 "aria-label": `Menu of ${heading(view).name}`, title: "Menu of this plot"}, "⋮")
    for (const kind of ["pointerdown", "pointerup", "click", "dblclick"]) {
      dots.addEventListener(kind, (event) => event.stopPropagation())
    }
    dots.addEventListener("click", () => open(view, dots))
    shadow_el.append(dots)
    again()
  }

  all.addEventListener("click", toggle)
  window.addEventListener("keydown", (event) => {
    const is_held = event.ctrlKey || event.metaKey || event.altKey || event.repeat
    if (event.key.toLowerCase() === "v" && !is_held && !window.insLabTypes?.(event)) toggle()
  })
  plots.forEach(equip)
  plots.added = equip
  plots.changed = () => again()
  cursor()?.properties.location.change.connect(ask)
  return root
}

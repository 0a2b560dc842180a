// Buttons and keys for undo and redo, and the browser's history, which follows that of the page: each entry has the
// number of a state. What came before this opening of the page is opened again by its address.

const FIELDS = ["text", "search", "number", "email", "password", "url", "tel"]
// Elements that do something of their own with Space, and those that do with arrows.
const ACTIVE = "a, button, input, select, summary, [role]:not([role=presentation]):not([role=tabpanel])"
const ARROWS = "input, select, [role=slider], [role=combobox], [role=tab], [role^=menu], [role=option], [role=radio]"
const CHOICES = "[role=tab], .MuiToggleButton-root"  // of which the arrows focus the next one
const STEPS = {arrowleft: -1, arrowright: 1}  // to the fix before, and to the next one
const WISHES = {h: "hold", escape: "close", "?": "help"}
const UNDO = "M12.5 8c-2.65 0-5.05.99-6.9 2.6L2 7v9h9l-3.62-3.62c1.39-1.16 3.16-1.88 5.12-1.88 3.54 0 6.55 2.31 7.6 5.5"
  + "l2.37-.78C21.08 11.03 17.15 8 12.5 8z"
const REDO = "M18.4 10.6C16.55 8.99 14.15 8 11.5 8c-4.65 0-8.58 3.03-9.96 7.22L3.9 16c1.05-3.19 4.05-5.5 7.6-5.5 1.95 0"
  + " 3.73.72 5.12 1.88L13 16h9V7l-3.6 3.6z"

const KEPT_UNDER = `ins-lab-kept ${window.location.pathname}`  // in the storage of this tab of the browser
const WAIT = 5000  // longest time that a busy browser takes to go to another entry [ms]
const KEPT = 32  // most wishes that wait for the server

const opening = String(Math.random())
const earlier = (state) => Boolean(state && (state.position > 0 || state.older))  // whether entries come before it
// The sheet covers the page: it has an entry of its own after that of the state, so that Back closes it.
const SHEET = /[?&]beside=Missions(&|$)/
let covered = SHEET.test(window.insLabOpened)
let over = false  // whether the present entry is that of the sheet
let older = earlier(window.history.state)  // whether this entry, of a page that was opened before, has such entries
let here = 0  // number of the present entry
let goal = null  // number of the entry to which the browser is on its way
let leaves = ""  // "going" on the way to an entry of another opening, "there" once it is to be opened
let seen = 0  // number of the last message of the server
let undos = 0  // how many were asked for
let told = 0  // how many of them the server had nothing for
let beyond = 0  // how many of these the browser still has to do
let timer = 0
let waiting = []  // entries to add
let model = null

// What the server wants kept for a page that comes back; a browser may refuse to store anything.
const before = (() => {
  try {
    return JSON.parse(window.sessionStorage.getItem(KEPT_UNDER))
  } catch {
    return null
  }
})()

let stores = before !== null  // whether there is something that another text must replace
function keep() {
  const unheard = [...window.insLabUnheard?.values() ?? []].map(({change}) => change)
  if (model === null || !(model.kept || unheard.length || stores)) return
  stores = true
  const text = JSON.stringify({search: window.location.search, kept: model.kept || "{}", unheard})
  try {
    window.sessionStorage.setItem(KEPT_UNDER, text)
  } catch {
    // a page that comes back has its address only
  }
}
// Neither `unload` nor `beforeunload` comes on a phone that puts the page away.
window.addEventListener("pagehide", keep)

function bring() {
  if (typeof before?.kept !== "string") return
  const is_same = before.search === window.insLabOpened
  model.brought = JSON.stringify({kept: before.kept, unheard: before.unheard, is_same})
}

const url = (search) => window.location.pathname + search + window.location.hash

// The server hears several wishes at once, or one after the other, in their order.
function ask(what, position) {
  const [last] = model.asked.at(-1) ?? [0]
  // The server may not have heard the wishes before: a newer value of a property replaces one that is on its way.
  model.asked = [...model.asked.slice(1 - KEPT), [last + 1, what, position]]
}

function put(position, search) {
  here = position
  window.history.replaceState({opening, position, older, over}, "", url(search))
}

function travel(by, position) {
  goal = position
  timer = setTimeout(arrive, WAIT)
  window.history.go(by)
}

function follow() {
  if (goal !== null || leaves) return
  for (const [position, search] of waiting) {
    here = position
    window.history[over ? "replaceState" : "pushState"]({opening, position, older}, "", url(search))
    over = false
  }
  waiting = []
  const {position, search, redone} = model.shown
  const covers = SHEET.test(search)
  // The page moved in its history, so the browser goes to that entry; nothing is written until it is there.
  if (position !== here || (over && !covers)) {
    const back = over ? 1 : 0
    over = false
    travel(position - here - back, position)
    return
  }
  if (covers && !covered && !over && !redone) {  // another entry would take the place of what can be redone
    over = true
    window.history.pushState({opening, position, older, over}, "", url(search))
  }
  covered = covers
  put(position, search)
  keep()
  if (model.shown.moves) window.location.reload()
}

// Where the entry does not exist, the present one takes its place.
function arrive() {
  clearTimeout(timer)
  here = goal
  goal = null
  follow()
  if (beyond > 0 || leaves) leave()
}

// What came before this opening of the page is undone by the browser, which opens its address once the server has heard
// all undos. Until then, the page writes no address: it would take the place of that one.
function leave() {
  if (goal !== null || leaves === "going") return
  if (beyond > 0 && older) {
    beyond -= 1
    leaves = "going"
    // Without an entry to go back to, the browser says nothing: the page goes on where it is.
    timer = setTimeout(() => { leaves = ""; follow() }, WAIT)
    window.history.back()
  } else if (model === null || model.shown.undos === undos) {
    window.location.reload()
  } else {  // a server that does not answer hears no more
    clearTimeout(timer)
    timer = setTimeout(() => window.location.reload(), WAIT)
  }
}

window.addEventListener("popstate", ({state}) => {
  if (state === null) {  // another fragment
    window.history.replaceState({opening, position: here, older}, "")
    return
  }
  clearTimeout(timer)
  if (model === null || state.opening !== opening || state.position < model.shown.oldest) {
    older = earlier(state)
    goal = null
    leaves = "there"
    leave()
  } else if (state.position === goal) {
    arrive()
  } else {
    ;({older} = state)
    leaves = ""
    goal = null
    // Back from the sheet to the state under it: the server closes the sheet.
    if (over && state.position === here) ask("close", 0)
    over = Boolean(state.over)
    here = state.position
    ask("visit", here)
  }
})

window.addEventListener("click", (event) => {
  // Chosen with the mouse, a tab or a part leaves the arrows to the fixes; a click by a key has no detail.
  const path = event.composedPath()
  if (event.detail) path.find((one) => one.matches?.(CHOICES))?.blur()
  const link = path.find((one) => one.dataset?.page)
  if (link && model !== null) {
    event.preventDefault()
    ask(link.dataset.page, 0)
  }
})

// Whether a key is written into a field: such keys do nothing else (plot_tools.js asks, too).
window.insLabTypes = (event) => {
  const [at] = event.composedPath()
  return at.isContentEditable || at.tagName === "TEXTAREA" || (at.tagName === "INPUT" && FIELDS.includes(at.type))
}

window.addEventListener("keydown", (event) => {
  const [at] = event.composedPath()
  if (model === null || window.insLabTypes(event) || event.altKey) return
  const key = event.key.toLowerCase()
  if (event.ctrlKey || event.metaKey) {
    if (key !== "z" || event.repeat) return
    event.preventDefault()
    ;(event.shiftKey ? redo : undo)()
  } else if (key in STEPS && !event.defaultPrevented && !at.closest?.(ARROWS)) {
    event.preventDefault()
    ask("step", STEPS[key])
  } else if (event.repeat) {
    return
  } else if (key === "/") {
    event.preventDefault()
    seek()
  } else if (key in WISHES) {
    ask(WISHES[key], 0)
  } else if (key === " " && !at.closest?.(ACTIVE)) {
    event.preventDefault()
    ask("play", 0)
  } else if (/^[1-9]$/.test(key)) {
    window.insLabTurn?.(Number(key))
  }
})

// The box that finds settings; the browser shows it first where the settings are folded away.
function seek() {
  const [box] = Array.from(Bokeh.index.query(({model}) => model.data?.label === "Find a setting"))
  const input = box?.container?.querySelector("input")
  if (!input) return
  if (input.getBoundingClientRect().right <= 0 || !input.checkVisibility()) {
    for (const {shadow_el} of Bokeh.index.roots) shadow_el?.querySelector('[aria-label="Open drawer"]')?.click()
  }
  setTimeout(() => input.focus(), 50)
}

const undo = () => {
  undos += 1
  ask("undo", 0)
}
const redo = () => ask("redo", 0)

function made(act, path) {
  const button = document.createElement("button")
  button.type = "button"
  button.innerHTML = `<svg viewBox="0 0 24 24" aria-hidden="true"><path d="${path}"/></svg>`
  button.addEventListener("click", act)
  return button
}

function name(button, word, change, keys) {
  button.disabled = !change
  button.setAttribute("aria-label", change ? `${word}: ${change}` : word)
  button.title = change ? `${word}: ${change} (${keys})` : `Nothing to ${word.toLowerCase()}`
}

export function render(props) {
  model = props.model
  const back = made(undo, UNDO)
  const forth = made(redo, REDO)
  const row = document.createElement("div")
  row.append(back, forth)

  const show = () => {
    const {position, pushed, undone, redone, count} = model.shown
    const leads_back = position === 0 && !undone && older
    name(back, "Undo", leads_back ? "the last change before the reload" : undone, "Ctrl+Z")
    name(forth, "Redo", redone, "Ctrl+Shift+Z")
    // Panel tells of each property by itself; a message of the server has a new count.
    if (count === seen) return
    seen = count
    waiting.push(...pushed)
    follow()
    beyond = older ? beyond + model.shown.beyond - told : 0
    told = model.shown.beyond
    if (beyond > 0 || leaves) leave()
  }
  model.on("shown", show)
  model.on("kept", keep)
  if (seen === 0) {
    if (window.location.search === window.insLabOpened) put(0, window.location.search)
    else window.location.reload()  // a person went on while the page was made
    // Before the document is ready, the server hears of no change.
    if (window.insLabReady) bring()
    else window.addEventListener("ins-lab-ready", bring, {once: true})
  }
  show()
  return row
}

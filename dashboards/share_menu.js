// A button with a menu of what is passed on. Texts are copied here, within the click; files are asked of the server.
// When the menu opens, the server is asked for the texts, so that nothing is sent while settings change.

const ICON = "M18 16.08c-.76 0-1.44.3-1.96.77L8.91 12.7c.05-.23.09-.46.09-.7s-.04-.47-.09-.7l7.05-4.11c.54.5 1.25.81 2.04.81"
  + " 1.66 0 3-1.34 3-3s-1.34-3-3-3-3 1.34-3 3c0 .24.04.47.09.7L8.04 9.81C7.5 9.31 6.79 9 6 9c-1.66 0-3 1.34-3 3s1.34 3 3 3"
  + "c.79 0 1.5-.31 2.04-.81l7.12 4.16c-.05.21-.08.43-.08.65 0 1.61 1.31 2.92 2.92 2.92s2.92-1.31 2.92-2.92-1.31-2.92-2.92-2.92z"
const TOAST = 2500  // how long it is said that something was copied [ms]
const KEPT = 60_000  // how long a file is kept for a browser that asks where to save it [ms]

function made(tag, properties) {
  return Object.assign(document.createElement(tag), properties)
}

// Without https, a browser gives no clipboard but by a selected text.
function copySelected(text) {
  const field = made("textarea", {value: text})
  field.style.cssText = "position: fixed; opacity: 0"
  document.body.append(field)
  field.select()
  let copied = false
  try { copied = document.execCommand("copy") } catch { copied = false }
  field.remove()
  return copied
}

async function copy(text) {
  try {
    await navigator.clipboard.writeText(text)
    return true
  } catch {
    return copySelected(text)
  }
}

function save(name, content) {
  const link = made("a", {download: name, href: URL.createObjectURL(new Blob([content]))})
  link.click()
  setTimeout(() => URL.revokeObjectURL(link.href), KEPT)
}

export function render({model}) {
  let fresh = false  // whether the texts are those of the page as it is
  let wanted = ""  // what was clicked before its text arrived
  let timer = 0
  const ask = (what) => { model.asked = {what, count: (model.asked.count || 0) + 1} }

  const row = document.createElement("div")
  const button = made("button", {
    type: "button", className: "share", title: "Pass on: link, command, report, data",
    innerHTML: `<svg viewBox="0 0 24 24" aria-hidden="true"><path d="${ICON}"/></svg><span>Share</span>`,
  })
  button.setAttribute("aria-label", "Share")
  button.setAttribute("aria-haspopup", "menu")
  button.setAttribute("aria-expanded", "false")
  const menu = made("div", {className: "menu", popover: "auto"})
  button.popoverTargetElement = menu
  const list = made("div", {role: "menu", ariaLabel: "Share"})
  const note = document.createElement("p")
  const toast = made("div", {className: "toast", role: "status"})
  const dialog = made("dialog", {innerHTML: "<p>The browser does not allow copying. Copy this text:</p>"})
  const field = made("textarea", {readOnly: true})
  field.setAttribute("aria-label", "Text to copy")
  const close = made("button", {type: "button", textContent: "Close"})
  close.addEventListener("click", () => dialog.close())
  dialog.append(field, close)

  async function give(key) {
    const text = model.told.texts[key]
    if (text === undefined) return
    const whole = key === "link" ? window.location.origin + window.location.pathname + text : text
    if (await copy(whole)) {
      toast.textContent = "Copied"
      toast.classList.add("shown")
      clearTimeout(timer)
      timer = setTimeout(() => { toast.classList.remove("shown"); toast.textContent = "" }, TOAST)
    } else {
      field.value = whole
      dialog.showModal()
      field.select()
    }
  }

  const items = new Map()
  for (const [key, label] of model.entries) {
    if (key === "") {
      list.append(document.createElement("hr"))
      continue
    }
    const item = made("button", {type: "button", role: "menuitem", textContent: label, tabIndex: -1})
    item.addEventListener("click", () => {
      if (item.getAttribute("aria-disabled") === "true") return
      menu.hidePopover()
      button.focus()
      if (!label.startsWith("Copy")) ask(key)
      else if (fresh) give(key)
      else wanted = key
    })
    item.autofocus = items.size === 0  // as soon as the menu is open: the next key is for it
    items.set(key, item)
    list.append(item)
  }
  menu.append(list, note)

  const show = () => {
    const {withheld, note: words} = model.told
    for (const [key, item] of items) {
      item.setAttribute("aria-disabled", String(key in withheld))
      item.title = withheld[key] || ""
    }
    note.textContent = words
    fresh = true
    if (wanted) give(wanted)
    wanted = ""
  }
  model.on("told", show)
  model.on("msg:custom", ([name, content]) => save(name, content))

  menu.addEventListener("beforetoggle", (event) => {
    const opens = event.newState === "open"
    button.setAttribute("aria-expanded", String(opens))
    if (!opens) return
    const place = button.getBoundingClientRect()
    menu.style.top = `${place.bottom + 4}px`
    menu.style.left = `${Math.max(8, Math.min(place.left, window.innerWidth - 238))}px`
    fresh = false
    ask("open")
  })
  menu.addEventListener("keydown", (event) => {
    const all = [...items.values()]
    const at = all.indexOf(list.getRootNode().activeElement)
    const next = {ArrowDown: at + 1, ArrowUp: at - 1 + all.length, Home: 0, End: all.length - 1}[event.key]
    if (next === undefined) return
    event.preventDefault()
    event.stopPropagation()
    all[next % all.length].focus()
  })
  row.append(button, menu, toast, dialog)
  return row
}

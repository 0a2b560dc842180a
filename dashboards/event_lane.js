// The events of a flight as spans above the slider: manoeuvres in the upper row, what goes wrong in the middle one,
// and notes, which people write, in the lower one. All that a note says is text, never markup.
// The lane is one stop of the Tab key; the arrow keys go from event to event.

const FAULTS = ["outage", "rejected", "saturated"]
const SMALLEST = 3  // width of the shortest event [px]

const clock = (time) => `${time.toFixed(1)} s`

function named([kind, start, end, words]) {
  const name = kind === "note" ? words : words[0].toUpperCase() + words.slice(1)
  return end > start ? `${name}: ${clock(start)} to ${clock(end)}` : `${name}: ${clock(start)}`
}

// The field in which a note is written, changed or deleted.
function writing(ask) {
  const element = document.createElement("form")
  element.setAttribute("role", "dialog")
  element.setAttribute("aria-label", "Note on the flight")
  const when = document.createElement("span")
  const field = document.createElement("input")
  Object.assign(field, {type: "text", maxLength: 200, placeholder: "What is there to see?"})
  field.setAttribute("aria-label", "Text of the note")
  const made = (label, type, act) => {
    const button = document.createElement("button")
    Object.assign(button, {type, textContent: label})
    button.addEventListener("click", act)
    return button
  }
  let about = {}
  let before = null  // what had the focus, and gets it back
  const close = () => {
    element.hidden = true
    before?.focus()
  }
  const send = (text) => {
    close()
    ask(about.note === undefined ? {start: about.start, end: about.end, text} : {note: about.note, text})
  }
  const away = made("Delete", "button", () => send(""))
  element.append(when, field, made("Save", "submit", () => {}), away, made("Cancel", "button", close))
  element.hidden = true
  element.addEventListener("submit", (event) => {
    event.preventDefault()
    send(field.value)
  })
  element.addEventListener("keydown", (event) => {
    event.stopPropagation()  // of the keys of the page
    if (event.key === "Escape") close()
  })
  const open = (note) => {
    about = note
    if (element.hidden) {
      before = document.activeElement
      while (before?.shadowRoot?.activeElement) before = before.shadowRoot.activeElement
    }
    when.textContent = note.end > note.start ? `${clock(note.start)} to ${clock(note.end)}` : clock(note.start)
    field.value = note.text
    away.hidden = note.note === undefined
    element.hidden = false
    field.focus()
  }
  return {element, open}
}

export function render({model}) {
  const lane = document.createElement("div")
  const hint = document.createElement("div")
  lane.className = "lane"
  lane.setAttribute("role", "toolbar")
  lane.setAttribute("aria-label", "Events of the flight")
  hint.className = "hint"
  hint.setAttribute("aria-hidden", "true")

  const say = (button) => {
    hint.textContent = button.title
    hint.hidden = false
    const {left, width} = lane.getBoundingClientRect()
    const place = button.getBoundingClientRect().left - left
    const room = hint.getBoundingClientRect().width
    hint.style.left = `${Math.max(0, Math.min(place, width - room))}px`
  }
  const hush = () => { hint.hidden = true }

  const ask = (wish) => { model.asked = {...wish, count: (model.asked.count || 0) + 1} }
  const form = writing(ask)

  const show = () => {
    const {duration} = model.shown
    const notes = model.notes.map(([start, end, text], number) => ["note", start, end, text, number])
    const events = [...model.shown.events, ...notes].sort(([, start], [, other]) => start - other)
    const lengths = events.map(([, start, end]) => end - start)
    hush()
    lane.replaceChildren(...events.map((event, index) => {
      const [kind, start, end, text, note] = event
      const button = document.createElement("button")
      button.type = "button"
      button.className = `${kind.replaceAll(" ", "-")} ${kind === "note" ? "" : FAULTS.includes(kind) ? "fault" : "flown"}`
      button.tabIndex = index === 0 ? 0 : -1
      button.title = named(event)
      button.setAttribute("aria-label", button.title)
      button.style.left = `min(${100 * start / duration}%, 100% - ${SMALLEST}px)`
      button.style.width = `max(${SMALLEST}px, ${100 * (end - start) / duration}%)`
      button.style.zIndex = lengths.filter((length) => length > end - start).length  // a short one is before a long one
      button.addEventListener("click", () => {
        ask({time: start})
        if (note === undefined) say(button)
        else form.open({start, end, text, note})
      })
      button.addEventListener("focus", () => say(button))
      button.addEventListener("blur", hush)
      button.addEventListener("pointerleave", hush)
      return button
    }))
    lane.hidden = events.length === 0
  }
  lane.addEventListener("keydown", (event) => {
    const step = {ArrowRight: 1, ArrowLeft: -1}[event.key]
    const all = [...lane.children]
    const from = all.findIndex((one) => one.matches(":focus"))
    if (!step || from < 0) return
    event.preventDefault()
    const to = all[Math.max(0, Math.min(from + step, all.length - 1))]
    all.forEach((one) => { one.tabIndex = one === to ? 0 : -1 })
    to.focus()
  })
  model.on("shown", show)
  model.on("notes", show)
  model.on("opened", () => form.open({...model.opened, text: ""}))
  show()
  const root = document.createElement("div")
  root.append(lane, hint, form.element)
  return root
}

// The events of a flight as spans above the slider: manoeuvres in the upper row, what goes wrong in the lower one.
// The lane is one stop of the Tab key; the arrow keys go from event to event.

const FAULTS = ["outage", "rejected", "saturated"]
const SMALLEST = 3  // width of the shortest event [px]

const clock = (time) => `${time.toFixed(1)} s`

function named([, start, end, words]) {
  const name = words[0].toUpperCase() + words.slice(1)
  return end > start ? `${name}: ${clock(start)} to ${clock(end)}` : `${name}: ${clock(start)}`
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

  const show = () => {
    const {duration} = model.shown
    // A short event stands before a long one.
    const events = [...model.shown.events].sort((one, other) => other[2] - other[1] - (one[2] - one[1]))
    hush()
    lane.replaceChildren(...events.map((event, index) => {
      const [kind, start, end] = event
      const button = document.createElement("button")
      button.type = "button"
      button.className = `${kind.replaceAll(" ", "-")} ${FAULTS.includes(kind) ? "fault" : "flown"}`
      button.tabIndex = index === 0 ? 0 : -1
      button.title = named(event)
      button.setAttribute("aria-label", button.title)
      button.style.left = `min(${100 * start / duration}%, 100% - ${SMALLEST}px)`
      button.style.width = `max(${SMALLEST}px, ${100 * (end - start) / duration}%)`
      button.addEventListener("click", () => {
        model.asked = {time: start, count: (model.asked.count || 0) + 1}
        say(button)
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
    const all = [...lane.children].sort((one, other) => one.offsetLeft - other.offsetLeft)
    const from = all.findIndex((one) => one.matches(":focus"))
    if (!step || from < 0) return
    event.preventDefault()
    const to = all[Math.max(0, Math.min(from + step, all.length - 1))]
    all.forEach((one) => { one.tabIndex = one === to ? 0 : -1 })
    to.focus()
  })
  model.on("shown", show)
  show()
  const root = document.createElement("div")
  root.append(lane, hint)
  return root
}

// What the page shows in two sentences, which a person closes for ever, and six figures of the run.

const KEY = "ins-lab-introduction"
let closed = false  // where the browser refuses to remember it

function isClosed() {
  try { return closed || window.localStorage.getItem(KEY) === "closed" } catch { return closed }
}

function close() {
  closed = true
  try { window.localStorage.setItem(KEY, "closed") } catch { /* until the page is left */ }
}

function made(tag, className, text) {
  const element = document.createElement(tag)
  element.className = className
  element.textContent = text
  if (tag === "button") element.type = "button"
  return element
}

export function render({model}) {
  const head = made("div", "head", "")
  const introduction = made("div", "introduction", "")
  const numbers = made("div", "numbers", "")
  const sentences = made("p", "", "")
  const actions = made("div", "actions", "")
  const away = made("button", "close", "×")
  away.setAttribute("aria-label", "Close the introduction for ever")
  away.title = "Close for ever"
  introduction.append(sentences, actions, away)
  head.append(introduction, numbers)

  const pressed = (key) => () => { model.asked = {key, count: (model.asked.count || 0) + 1} }
  const shown = {actions: "", numbers: ""}

  // Buttons are made anew only where there are others: one that has the focus keeps it.
  function fill(place, name, keys, make) {
    if (shown[name] === String(keys)) return
    shown[name] = String(keys)
    place.replaceChildren(...keys.map((key) => {
      const button = make()
      button.addEventListener("click", pressed(key))
      return button
    }))
  }

  function show() {
    const {sentences: text, actions: offered, numbers: figures} = model.content
    sentences.textContent = text
    introduction.hidden = !text || isClosed()
    fill(actions, "actions", offered.map(([key]) => key), () => made("button", "", ""))
    offered.forEach(([, label], i) => { actions.children[i].textContent = label })
    fill(numbers, "numbers", figures.map(([key]) => key), () => {
      const button = made("button", "", "")
      button.append(made("b", "", ""), made("span", "", ""), made("span", "step", ""))
      return button
    })
    figures.forEach(([, ...words], i) => {
      words.forEach((word, j) => { numbers.children[i].children[j].textContent = word })
    })
    numbers.hidden = figures.length === 0
  }
  away.addEventListener("click", () => { close(); show() })
  model.on("content", show)
  show()
  return head
}

// The missions as cards. Whatever comes from a file is set as text; only the picture, which the server drew, is markup.

function made(kind, name, text) {
  const element = document.createElement(kind)
  element.className = name
  if (text !== undefined) element.textContent = text
  if (kind === "button") element.type = "button"
  return element
}

export function render({model}) {
  const grid = made("div", "grid")

  // A message would send the whole component along, pictures and all. The count tells a repeated wish from the last.
  const act = (what, name) => { model.wish = {what, name, count: (model.wish.count || 0) + 1} }

  // Pictures by name. One of an older list is shown until its new one arrives.
  const drawings = new Map()
  const lacking = new Set()  // names of cards in view
  let asked = new Set()  // names for which the server was asked, and has not answered
  const view = new IntersectionObserver((entries) => {
    for (const {target, isIntersecting} of entries) {
      if (isIntersecting) lacking.add(target.dataset.name)
      else lacking.delete(target.dataset.name)
    }
    ask()
  }, {rootMargin: "200px"})

  function ask() {
    if (asked.size || !lacking.size) return
    asked = new Set([...lacking].slice(0, 48))
    model.asked = {names: [...asked], count: (model.asked.count || 0) + 1}
  }

  function fill(box) {
    const drawn = drawings.get(box.dataset.name)
    if (!drawn) return
    const face = box.querySelector(".face")
    face.disabled = Boolean(drawn.problem)
    face.querySelector(".picture").innerHTML = drawn.picture
    face.querySelector(".picture").hidden = Boolean(drawn.problem)
    face.querySelector(".problem").textContent = drawn.problem
    face.querySelector(".duration").textContent = drawn.duration
  }

  function answered() {
    for (const [name, drawn] of Object.entries(model.drawn.cards)) drawings.set(name, drawn)
    if (model.drawn.count !== model.asked.count) return  // what was asked before the list changed
    for (const box of grid.querySelectorAll(".card")) {
      if (!asked.has(box.dataset.name)) continue
      fill(box)
      view.unobserve(box)
      lacking.delete(box.dataset.name)
    }
    asked = new Set()
    ask()
  }

  function card(mission) {
    const box = made("article", "card")
    box.dataset.name = mission.name
    box.dataset.words = mission.words
    const face = made("button", "face")
    face.setAttribute("aria-label", `Choose ${mission.title}`)
    face.title = mission.origin
    face.disabled = Boolean(mission.problem)
    face.onclick = () => act("choose", mission.name)
    const picture = made("div", "picture")
    picture.hidden = Boolean(mission.problem)
    const head = made("div", "head")
    head.append(made("span", "title", mission.title), made("span", "duration"))
    face.append(picture, head, made("div", "about", mission.about), made("div", "problem", mission.problem))
    const foot = made("div", "foot")
    foot.append(made("code", "name", mission.name))
    for (const tag of mission.tags) {
      const chip = made("button", "tag", tag)
      chip.title = "Show missions with this tag"
      chip.onclick = () => act("filter", tag)
      foot.append(chip)
    }
    if (mission.own) {
      const tools = made("span", "tools")
      for (const [what, word] of [["edit", "Edit"], ["delete", "Delete"]]) {
        if (what === "edit" && mission.problem) continue
        const button = made("button", "tool", word)
        button.setAttribute("aria-label", `${word} ${mission.name}`)
        button.onclick = () => act(what, mission.name)
        tools.append(button)
      }
      foot.append(tools)
    }
    box.append(face, foot)
    if (!mission.problem) {
      fill(box)
      view.observe(box)
    }
    return box
  }

  function mark() {
    const words = model.filter.toLowerCase().split(/\s+/).filter(Boolean)
    let shown = 0
    for (const box of grid.querySelectorAll(".card")) {
      box.hidden = !words.every((word) => box.dataset.words.includes(word))
      shown += !box.hidden
      const chosen = box.dataset.name === model.chosen
      box.classList.toggle("chosen", chosen)
      box.querySelector(".face").setAttribute("aria-pressed", chosen)
    }
    grid.querySelector(".none").hidden = shown > 0 || model.missions.length === 0
  }

  function draw() {
    view.disconnect()
    lacking.clear()
    asked = new Set()
    grid.replaceChildren(...model.missions.map(card), made("p", "none", "No mission contains all these words."))
    mark()
  }

  model.on("missions", draw)
  model.on("drawn", answered)
  model.on(["chosen", "filter"], mark)
  draw()
  // Once the browser has this component, the server may send changes; before, they would overtake it.
  act("ready", "")
  return grid
}

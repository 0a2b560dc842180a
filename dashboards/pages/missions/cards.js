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

  function card(mission) {
    const box = made("article", "card")
    box.dataset.name = mission.name
    box.dataset.words = mission.words
    const face = made("button", "face")
    face.setAttribute("aria-label", `Choose ${mission.title}`)
    face.disabled = Boolean(mission.problem)
    face.onclick = () => act("choose", mission.name)
    const picture = made("div", mission.problem ? "problem" : "picture")
    if (mission.problem) picture.textContent = mission.problem
    else picture.innerHTML = mission.picture
    const head = made("div", "head")
    head.append(made("span", "title", mission.title), made("span", "duration", mission.duration))
    face.append(picture, head, made("div", "origin", mission.origin))
    if (mission.problem) face.append(picture)
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
    grid.replaceChildren(...model.missions.map(card), made("p", "none", "No mission contains all these words."))
    mark()
  }

  model.on("missions", draw)
  model.on(["chosen", "filter"], mark)
  draw()
  // Once the browser has this component, the server may send changes; before, they would overtake it.
  act("ready", "")
  return grid
}

// All sensor cards in a table: a press on a name loads the card, a press on a heading sorts.

function cell(tag, text, kind) {
  const made = document.createElement(tag)
  made.textContent = text
  if (kind) made.className = kind
  return made
}

export function render({model}) {
  const box = document.createElement("div")
  let by = 0, down = false

  const draw = () => {
    const {heads, rows} = model.cards
    const table = document.createElement("table")
    const head = document.createElement("tr")
    heads.forEach((title, index) => {
      const th = cell("th", "", "")
      const press = cell("button", title, "sort")
      if (index === by) th.setAttribute("aria-sort", down ? "descending" : "ascending")
      press.onclick = () => { down = index === by && !down; by = index; draw() }
      th.append(press)
      head.append(th)
    })
    table.append(head)
    const order = [...rows].sort((a, b) => {
      const [x, y] = [a.keys[by], b.keys[by]]
      if (x === null || y === null) return (x === null) - (y === null)
      return (x < y ? -1 : x > y ? 1 : 0) * (down ? -1 : 1)
    })
    for (const row of order) {
      const line = document.createElement("tr")
      if (row.name === model.chosen) line.className = "chosen"
      row.texts.forEach((text, index) => {
        const td = cell("td", index ? text : "", row.assumed[index] ? "assumed" : "")
        if (index === 0) {
          const press = cell("button", text, "load")
          press.title = "Load this card"
          press.setAttribute("aria-pressed", String(row.name === model.chosen))
          press.onclick = () => { model.asked = {name: row.name, count: (model.asked.count || 0) + 1} }
          td.append(press)
        }
        line.append(td)
      })
      table.append(line)
    }
    box.replaceChildren(table)
  }

  model.on("cards", draw)
  model.on("chosen", draw)
  draw()
  return box
}

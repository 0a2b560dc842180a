// The columns of a csv, each with what it is taken for, to be corrected. Whatever comes from a file is set as text.

function made(kind, name, text) {
  const element = document.createElement(kind)
  element.className = name
  if (text !== undefined) element.textContent = text
  return element
}

export function render({model}) {
  const table = made("table", "columns")

  function choice(label, options, value, change) {
    const box = made("select", "choice")
    box.setAttribute("aria-label", label)
    for (const [key, words] of options) {
      const option = made("option", "", words)
      option.value = key
      box.append(option)
    }
    box.value = value
    box.onchange = () => change(box.value)
    return box
  }

  function row(column, place) {
    const line = made("tr", column.unsure ? "unsure" : "")
    const said = {...column}
    const cells = {}
    for (const name of ["quantity", "axis", "unit"]) {
      cells[name] = made("td", name)
      cells[name].dataset.label = {quantity: "Quantity", axis: "Axis or sign", unit: "Unit"}[name]
    }
    function send() {
      const {quantity, axis, unit} = said
      model.edits = {...model.edits, [place]: {quantity, axis, unit}}
    }
    function fill() {
      const kind = model.quantities[said.quantity]
      const named = ([key, words]) => [key, words]
      const of = `of ${column.heading}`
      cells.quantity.replaceChildren(choice(`Quantity ${of}`, Object.entries(model.quantities).map(
        ([key, one]) => [key, one.label]), said.quantity, (value) => {
          said.quantity = value
          said.axis = model.quantities[value].axes[0] || ""
          said.unit = ""
          fill()
          send()
        }))
      cells.axis.replaceChildren(...(kind.axes.length ? [choice(`Axis or sign ${of}`,
        kind.axes.map((one) => [one, one.replace("-", "−")]), said.axis, (value) => { said.axis = value; send() })] : []))
      cells.unit.replaceChildren(...(kind.units.length ? [choice(`Unit ${of}`,
        [["", "by the data"], ...kind.units.map((one) => named([one, one]))], said.unit,
        (value) => { said.unit = value; send() })] : []))
    }
    fill()
    const head = made("th", "heading", column.heading)
    head.scope = "row"
    if (column.file) head.append(made("span", "file", column.file))
    const evidence = made("td", "evidence", column.evidence)
    line.append(head, cells.quantity, cells.axis, cells.unit, evidence)
    return line
  }

  function draw() {
    const names = made("tr", "")
    for (const word of ["Column", "Quantity", "Axis or sign", "Unit", "Evidence"]) {
      const cell = made("th", "", word)
      cell.scope = "col"
      names.append(cell)
    }
    const head = made("thead", "")
    head.append(names)
    const body = made("tbody", "")
    body.append(...model.columns.map(row))
    table.replaceChildren(head, body)
  }

  model.on("columns", draw)
  draw()
  return table
}

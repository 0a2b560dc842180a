const {what} = cb_obj.data;
if (what.length > 0) {
  const {streams, ages, sets} = JSON.parse(what[0]);
  const changed = new Map();  // each source changes once
  const dataOf = (model) => changed.get(model) ?? models[model].data;
  for (const [model, columns, rollover] of streams) {
    const before = dataOf(model), data = {...before};
    for (const [name, values] of columns) {
      const added = values.map((value) => value ?? NaN);
      data[name] = rollover == null ? added : [...before[name], ...added].slice(-rollover);
    }
    changed.set(model, data);
  }
  for (const [model, now, window] of ages) {
    const {age, ...rows} = dataOf(model);
    const shown = rows.time.findIndex((time) => time >= now - window);
    const begin = Math.max(shown < 0 ? rows.time.length - 1 : shown - 1, 0);
    const data = {};
    for (const name in rows) data[name] = rows[name].slice(begin);
    data.age = Array.from(data.time, (time) => now - time);
    changed.set(model, data);
  }
  for (const [model, data] of changed) models[model].setv({data}, {sync: false});
  for (const [model, values] of sets) models[model].setv(values, {sync: false});
  cb_obj.data = {what: []};  // the receipt
}

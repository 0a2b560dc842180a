let width, height;
try { width = fig.inner_width; height = fig.inner_height; } catch { return; }  // it is not laid out yet
if (!(width > 0 && height > 0)) return;
const axes = [[x, width], [y, height]], state = fig.equal_scale ??= axes.map(() => ({}));
axes.forEach(([{start, end}], k) => {
  if (state[k].start !== start || state[k].end !== end) state[k].wanted = [start, end];  // others set them
});
const scale = Math.max(...axes.map(([, pixels], k) => (state[k].wanted[1] - state[k].wanted[0]) / pixels));
axes.forEach(([range, pixels], k) => {  // `scale` is metres of a pixel
  const [low, high] = state[k].wanted, more = (scale * pixels - (high - low)) / 2;
  state[k].start = low - more;
  state[k].end = high + more;
});
axes.forEach(([range], k) => range.setv({start: state[k].start, end: state[k].end}, {sync: false}));

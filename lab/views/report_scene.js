{
  const scene = document.getElementById("scene"), paths = JSON.parse(scene.dataset.paths);
  let azimuth = +scene.dataset.azimuth, elevation = +scene.dataset.elevation, from = null;
  const draw = () => {
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    scene.querySelectorAll("polyline").forEach((line, index) => {
      line.setAttribute("points", paths[index].map(([e, n, u]) =>
        `${(e * ca + n * sa).toFixed(1)},${((e * sa - n * ca) * se - u * ce).toFixed(1)}`).join(" "));
    });
  };
  const turn = (by, up) => {
    azimuth += by;
    elevation = Math.min(Math.max(elevation + up, 0), Math.PI / 2);
    draw();
  };
  scene.addEventListener("pointerdown", (event) => {
    from = event;
    scene.setPointerCapture(event.pointerId);
  });
  for (const end of ["pointerup", "pointercancel"]) scene.addEventListener(end, () => { from = null; });
  scene.addEventListener("pointermove", (event) => {
    if (!from) return;
    turn((event.clientX - from.clientX) / 150, (event.clientY - from.clientY) / 150);
    from = event;
  });
  scene.addEventListener("keydown", ({key}) => {
    const step = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[key];
    if (step) turn(...step);
  });
}

// Pictures in stages that zoom and move together. `slide` gets the share of the width that is pressed while nothing is
// zoomed, `arrow` the name of an arrow key that is pressed then.
const zooming = (stages, layers, { slide, arrow }) => {
  const LARGEST = 32;
  const said = document.getElementById("zoom-said");
  let zoom = { scale: 1, across: 0, down: 0 }; // shift in shares of the stage's width and height

  function apply() {
    const room = zoom.scale - 1; // the picture always fills the stage
    zoom.across = Math.min(0, Math.max(-room, zoom.across));
    zoom.down = Math.min(0, Math.max(-room, zoom.down));
    for (const layer of layers) {
      layer.style.transform = `translate(${100 * zoom.across}%, ${100 * zoom.down}%) scale(${zoom.scale})`;
    }
    for (const stage of stages) stage.classList.toggle("zoomed", zoom.scale > 1);
    said.textContent = `${zoom.scale.toFixed(1)} times`;
  }

  function zoomBy(factor, across = 0.5, down = 0.5) {
    const scale = Math.min(LARGEST, Math.max(1, zoom.scale * factor));
    const change = scale / zoom.scale; // the point under the pointer stays where it is
    zoom = { scale, across: across - (across - zoom.across) * change, down: down - (down - zoom.down) * change };
    apply();
  }

  function move(across, down) {
    zoom.across += across;
    zoom.down += down;
    apply();
  }

  function whole() {
    zoom = { scale: 1, across: 0, down: 0 };
    apply();
  }

  function moved(pointers, event, now) {
    const before = [...pointers.values()].map((each) => [...each]);
    const was = pointers.get(event.pointerId);
    pointers.set(event.pointerId, now);
    if (pointers.size === 2) {
      const after = [...pointers.values()];
      const apart = ([one, other]) => Math.hypot(one[0] - other[0], one[1] - other[1]);
      if (apart(before) > 0) zoomBy(apart(after) / apart(before), (after[0][0] + after[1][0]) / 2, (after[0][1] + after[1][1]) / 2);
    } else if (zoom.scale > 1) move(now[0] - was[0], now[1] - was[1]);
    else slide(event.currentTarget, now[0]);
  }

  function watch(stage) {
    const pointers = new Map();
    const shares = (event) => {
      const frame = stage.getBoundingClientRect();
      return [(event.clientX - frame.left) / frame.width, (event.clientY - frame.top) / frame.height];
    };
    stage.addEventListener("wheel", (event) => {
      if (document.activeElement !== stage && !event.ctrlKey) return; // the page scrolls over unclicked pictures
      event.preventDefault();
      zoomBy(Math.exp(-event.deltaY / 300), ...shares(event));
    }, { passive: false });
    stage.addEventListener("pointerdown", (event) => {
      stage.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, shares(event));
      if (zoom.scale === 1 && pointers.size === 1) slide(stage, shares(event)[0]);
    });
    stage.addEventListener("pointermove", (event) => {
      if (pointers.has(event.pointerId)) moved(pointers, event, shares(event));
    });
    for (const name of ["pointerup", "pointercancel"]) {
      stage.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    const keys = {
      "+": () => zoomBy(1.5), "=": () => zoomBy(1.5), "-": () => zoomBy(1 / 1.5), 0: whole,
      ArrowLeft: () => move(0.1, 0), ArrowRight: () => move(-0.1, 0), ArrowUp: () => move(0, 0.1), ArrowDown: () => move(0, -0.1),
    };
    stage.addEventListener("keydown", (event) => {
      if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      if (event.key.startsWith("Arrow") && zoom.scale === 1) arrow(event.key);
      else keys[event.key]();
    });
  }

  document.getElementById("zoom-in").addEventListener("click", () => zoomBy(1.5));
  document.getElementById("zoom-out").addEventListener("click", () => zoomBy(1 / 1.5));
  document.getElementById("zoom-none").addEventListener("click", whole);
  stages.forEach(watch);
  apply();
};

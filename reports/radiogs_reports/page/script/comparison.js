// Two pictures under one slider with their error beside them; all zoom and move together.
(() => {
  const { data, fill, nameOf } = shared;
  const found = (name) => document.getElementById(name);
  if (!found("images")) return; // no cell keeps pictures, or none is finished
  const [cellSelect, mapSelect, leftSelect] = ["compare-cell", "compare-map", "compare-left"].map(found);
  const [stage, errorStage, clip, edge, slider] = ["compare-stage", "error-stage", "compare-clip", "compare-edge", "compare-slider"].map(found);
  const [leftImage, rightImage, errorImage] = ["compare-left-image", "compare-right-image", "error-image"].map(found);
  const layers = [leftImage, rightImage, errorImage];
  const LARGEST = 32;
  const TRUTH = "truth";
  const kept = data.runs.filter((run) => found(`view-${run.key}`));
  let runs = kept;
  const opened = new Map();
  let zoom = { scale: 1, across: 0, down: 0 }; // shift in shares of the stage's width and height

  function pictures(id) {
    if (!opened.has(id)) opened.set(id, JSON.parse(found(id).textContent));
    return opened.get(id);
  }

  const chosen = () => runs[cellSelect.selectedIndex];

  function source(image, address, text) {
    image.hidden = address === undefined;
    if (address === undefined) image.removeAttribute("src");
    else image.src = address;
    image.alt = text;
  }

  function offer() {
    const run = chosen();
    const maps = pictures(`view-${run.key}`).mine;
    fill(mapSelect, Object.keys(data.kinds).filter((name) => name in maps).map((name) => [name, data.kinds[name].label]));
    const others = runs.filter((other) => other.scene === run.scene && other.view === run.view && other.key !== run.key);
    const truth = Object.keys(pictures(`truth-${run.truth}`)).length ? [[TRUTH, "ground truth"]] : [];
    fill(leftSelect, [...truth, ...others.map((other) => [other.key, nameOf(other)])]);
  }

  function show() {
    const run = chosen();
    const map = mapSelect.value;
    const { mine, error } = pictures(`view-${run.key}`);
    const left = leftSelect.value;
    const leftRun = runs.find((other) => other.key === left);
    const pair = left === TRUTH ? pictures(`truth-${run.truth}`)[map] : leftRun && pictures(`view-${left}`).mine[map];
    const leftName = left === TRUTH ? "ground truth" : leftRun ? nameOf(leftRun) : "nothing to compare with";
    const light = map === "relit" && run.light ? ` under ${run.light}` : "";
    source(rightImage, mine[map], `${data.kinds[map].label}${light}, ${nameOf(run)}`);
    source(leftImage, pair, `${data.kinds[map].label}${light}, ${leftName}`);
    source(errorImage, error[map], `error of ${data.kinds[map].label}, ${nameOf(run)}`);
    found("error-none").hidden = error[map] !== undefined;
    found("error-unit").textContent = data.kinds[map].unit;
    found("compare-left-name").textContent = `◀ ${pair === undefined ? "n/a: no ground truth for this map" : leftName}`;
    found("compare-right-name").textContent = `${nameOf(run)}, view ${run.view}${light} ▶`;
  }

  function slide() {
    const share = Number(slider.value);
    clip.style.clipPath = `inset(0 ${100 - share}% 0 0)`;
    edge.style.left = `${share}%`;
  }

  function apply() {
    zoom.scale = Math.min(LARGEST, Math.max(1, zoom.scale));
    const room = zoom.scale - 1; // the picture always fills the stage
    zoom.across = Math.min(0, Math.max(-room, zoom.across));
    zoom.down = Math.min(0, Math.max(-room, zoom.down));
    for (const layer of layers) {
      layer.style.transform = `translate(${100 * zoom.across}%, ${100 * zoom.down}%) scale(${zoom.scale})`;
    }
    for (const each of [stage, errorStage]) each.classList.toggle("zoomed", zoom.scale > 1);
    found("zoom-said").textContent = `${zoom.scale.toFixed(1)} times`;
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

  function watch(element) {
    const pointers = new Map();
    const shares = (event) => {
      const frame = element.getBoundingClientRect();
      return [(event.clientX - frame.left) / frame.width, (event.clientY - frame.top) / frame.height];
    };
    element.addEventListener("wheel", (event) => {
      if (document.activeElement !== element && !event.ctrlKey) return; // the page scrolls over unclicked pictures
      event.preventDefault();
      zoomBy(Math.exp(-event.deltaY / 300), ...shares(event));
    }, { passive: false });
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, shares(event));
      if (element === stage && zoom.scale === 1 && pointers.size === 1) setSlider(shares(event)[0]);
    });
    element.addEventListener("pointermove", (event) => {
      if (!pointers.has(event.pointerId)) return;
      const before = [...pointers.values()].map((each) => [...each]);
      const [was, now] = [pointers.get(event.pointerId), shares(event)];
      pointers.set(event.pointerId, now);
      if (pointers.size === 2) {
        const after = [...pointers.values()];
        const apart = ([one, other]) => Math.hypot(one[0] - other[0], one[1] - other[1]);
        if (apart(before) > 0) zoomBy(apart(after) / apart(before), (after[0][0] + after[1][0]) / 2, (after[0][1] + after[1][1]) / 2);
      } else if (zoom.scale > 1) move(now[0] - was[0], now[1] - was[1]);
      else if (element === stage) setSlider(now[0]);
    });
    for (const name of ["pointerup", "pointercancel"]) {
      element.addEventListener(name, (event) => pointers.delete(event.pointerId));
    }
    const keys = {
      "+": () => zoomBy(1.5), "=": () => zoomBy(1.5), "-": () => zoomBy(1 / 1.5), 0: whole,
      ArrowLeft: () => move(0.1, 0), ArrowRight: () => move(-0.1, 0), ArrowUp: () => move(0, 0.1), ArrowDown: () => move(0, -0.1),
    };
    element.addEventListener("keydown", (event) => {
      if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key.startsWith("Arrow") && zoom.scale === 1) return; // then arrows scroll the page
      event.preventDefault();
      keys[event.key]();
    });
  }

  function setSlider(share) {
    slider.value = 100 * Math.min(1, Math.max(0, share));
    slide();
  }

  function shape() {
    if (!rightImage.naturalWidth) return;
    for (const each of [stage, errorStage]) each.style.aspectRatio = `${rightImage.naturalWidth} / ${rightImage.naturalHeight}`;
  }

  function follow() {
    const ticked = kept.filter((run) => shared.selection().holds(run));
    found("compare-none").hidden = ticked.length > 0;
    runs = ticked.length ? ticked : kept;
    fill(cellSelect, runs.map((run) => [run.key, nameOf(run)]));
    offer();
    show();
  }

  document.addEventListener("selection", follow);
  cellSelect.addEventListener("change", () => {
    offer();
    show();
  });
  for (const select of [mapSelect, leftSelect]) select.addEventListener("change", show);
  slider.addEventListener("input", slide);
  rightImage.addEventListener("load", shape);
  found("zoom-in").addEventListener("click", () => zoomBy(1.5));
  found("zoom-out").addEventListener("click", () => zoomBy(1 / 1.5));
  found("zoom-none").addEventListener("click", whole);
  [stage, errorStage].forEach(watch);
  document.addEventListener("showcell", (event) => {
    if (!runs.some((run) => run.key === event.detail)) runs = kept;
    fill(cellSelect, runs.map((run) => [run.key, nameOf(run)]));
    cellSelect.value = event.detail;
    cellSelect.dispatchEvent(new Event("change"));
    found("images").scrollIntoView();
    cellSelect.focus();
  });
  follow();
  slide();
  apply();
})();

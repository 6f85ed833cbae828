// The viewer of surfels: which models are seen, from where, in which light, and as what.
(() => {
  const { data, fill, nameOf } = shared;
  const found = (name) => document.getElementById(`surfels${name}`);
  if (!found("")) return; // no cell keeps surfels
  const NAMES = ["-left", "-right", "-shown", "-said", "-light", "-drag", "-turn", "-strength", "-sun", "-file"];
  const [leftSelect, rightSelect, shownSelect, said, lightSelect, dragSelect, turnRange, strengthRange, sunRange, file] = NAMES.map(found);
  const stages = [...document.querySelectorAll(".turnable")];
  const kept = data.runs.filter((run) => found(`-${run.key}`));
  const models = new Map();
  const START = { turn: 0, tilt: 0, distance: 1 }; // as seen by the camera whose maps are kept
  const SUN = { turn: 0.7, height: 0.8 };
  const RECOVERED = "recovered"; // a model's own light
  const offered = JSON.parse(found("-maps").textContent);
  const maps = new Map(Object.entries(offered).map(([name, text]) => [name, lightMaps.fromHdr(surfelData.bytesOf(text))]));
  let camera = { ...START };
  let sun = { ...SUN };
  let asked = false;
  const lit = new Map(); // the light of each model, until something about it changes
  const drawers = [];

  function modelOf(key) {
    if (!models.has(key)) models.set(key, surfelData.unpacked(JSON.parse(found(`-${key}`).textContent)));
    return models.get(key);
  }

  function lightOf(model) { // null where the model has no such light
    if (lit.has(model)) return lit.get(model);
    const [kind, name] = lightSelect.value.split(/:(.*)/);
    const radiance = kind === "map" ? maps.get(name) : model.lights[name];
    const { up } = model;
    const settings = {
      up, turn: (turnRange.valueAsNumber * Math.PI) / 180, upright: kind === "map", strength: 2 ** strengthRange.valueAsNumber,
      sun: { strength: sunRange.valueAsNumber, towards: turning.towards(model.frame, sun.turn, sun.height) },
    };
    lit.set(model, radiance ? lightMaps.entries(radiance, settings) : null);
    return lit.get(model);
  }

  function paint() {
    asked = false;
    [leftSelect, rightSelect].forEach((select, side) => {
      if (!select.value) return;
      drawers[side] ??= drawing.drawer(stages[side]);
      if (!drawers[side]) {
        said.textContent = "This browser has no WebGL 2 with floating-point colours: surfels cannot be shown.";
        return;
      }
      const model = modelOf(select.value);
      const light = shading.isLit(shownSelect.value) && model.relightable ? lightOf(model) : null;
      const seen = light || !shading.isLit(shownSelect.value) ? shownSelect.value : "radiance";
      drawers[side](model, light, turning.seenFrom(model, camera), seen, background());
    });
  }

  function background() { // the page's own, display colour
    const [, ...digits] = shared.colour("--raised").match(/^#(..)(..)(..)$/);
    return digits.map((each) => parseInt(each, 16) / 255);
  }

  function repaint() {
    if (asked || !found("-shown-here").open) return;
    asked = true;
    requestAnimationFrame(paint);
  }

  function relight() {
    lit.clear();
    repaint();
  }

  function tell() {
    [leftSelect, rightSelect].forEach((select, side) => {
      stages[side].closest("figure").hidden = !select.value;
    });
    const shown = [leftSelect, rightSelect].filter((select) => select.value).map((select) => [select.selectedOptions[0].textContent, modelOf(select.value)]);
    const sizes = shown.map(([name, model]) => {
      const text = model.number.toLocaleString("en");
      const count = model.number < model.count ? `the ${text} that cover most of ${model.count.toLocaleString("en")}` : text;
      const light = lightSelect.selectedOptions[0]?.textContent;
      const under = lightOf(model) ? `, under the light ${light}` : `; it has no light ${light}, and is shown as trained`;
      return `${name}: ${count} surfels${model.relightable && shading.isLit(shownSelect.value) ? under : ""}`;
    });
    const fixed = shown.some(([, model]) => !model.relightable) ? " Results without visibility cannot be relit here." : "";
    said.textContent = `${sizes.join("; ")}.${fixed}`;
    repaint();
  }

  function offerLights() { // those of the shown models, and maps
    const names = new Set([leftSelect, rightSelect].flatMap((select) => (select.value ? Object.keys(modelOf(select.value).lights) : [])));
    const own = [...names].map((name) => [`own:${name}`, name === RECOVERED ? "of training, as recovered" : name]);
    fill(lightSelect, [...own, ...[...maps.keys()].map((name) => [`map:${name}`, `map: ${name}`])]);
    relight();
    tell();
  }

  const MOVED = { // by dragging and arrow keys, in radians
    camera: (turn, tilt) => { camera = { ...camera, turn: camera.turn - turn, tilt: turning.within(-3.1, camera.tilt + tilt, 3.1) }; },
    light: (turn) => { turnRange.value = ((turnRange.valueAsNumber + (turn * 180) / Math.PI + 540) % 360) - 180; },
    sun: (turn, tilt) => {
      if (!sunRange.valueAsNumber) sunRange.value = 2;
      sun = { turn: sun.turn + turn, height: turning.within(-1.57, sun.height - tilt, 1.57) };
    },
  };

  const moves = {
    turned(turn, tilt) {
      MOVED[dragSelect.value](turn, tilt);
      if (dragSelect.value === "camera") repaint();
      else relight();
    },
    nearer(factor) {
      camera.distance = turning.within(0.05, camera.distance * factor, 5);
      repaint();
    },
    anew() {
      camera = { ...START };
      sun = { ...SUN };
      turnRange.value = 0;
      relight();
    },
  };

  async function take(given) { // a map from a file, which stays in the page
    if (!given) return;
    try {
      maps.set(given.name, await lightMaps.fromFile(given));
      offerLights();
      lightSelect.value = `map:${given.name}`;
      relight();
      tell();
    } catch (error) {
      said.textContent = `${given.name} ${error.message} Drop a .hdr or .png of the whole sphere.`;
    }
  }

  function follow() {
    const ticked = kept.filter((run) => shared.selection().holds(run));
    const names = (ticked.length ? ticked : kept).map((run) => [run.key, nameOf(run)]);
    fill(leftSelect, names);
    fill(rightSelect, [["", "nothing"], ...names]);
    offerLights();
  }

  for (const stage of stages) turning.follow(stage, moves);
  for (const select of [leftSelect, rightSelect]) select.addEventListener("change", offerLights);
  for (const each of [shownSelect, lightSelect]) each.addEventListener("change", () => { relight(); tell(); });
  for (const each of [turnRange, strengthRange, sunRange]) each.addEventListener("input", relight);
  file.addEventListener("change", () => take(file.files[0]));
  for (const name of ["dragover", "drop"]) {
    found("").addEventListener(name, (event) => {
      event.preventDefault(); // else the browser would leave the page for the file
      if (name === "drop") take(event.dataTransfer.files[0]);
    });
  }
  document.addEventListener("themechange", repaint);
  document.addEventListener("selection", follow);
  found("-shown-here").addEventListener("toggle", tell);
  new ResizeObserver(repaint).observe(stages[0]);
  follow();
  const [first] = kept;
  if (!modelOf(first.key).relightable) shownSelect.value = "radiance";
  const beside = kept.find((run) => run.scene === first.scene && run.seed === first.seed && run.row !== first.row);
  if (beside) rightSelect.value = beside.key;
  offerLights();
})();

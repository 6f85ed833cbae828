// Every map of every kept view and light: two rows, or a row and the truth, under a slider, with the error beside them.
const browser = (() => {
  const { data, texts, fill } = shared;
  const found = (name) => document.getElementById(name);
  if (!found("images")) return null; // no cell keeps pictures, or none is finished
  const [sceneSelect, seedSelect, viewSelect, mapSelect] = ["browse-scene", "browse-seed", "browse-view", "browse-map"].map(found);
  const [leftSelect, rightSelect, slider, gainSelect] = ["compare-left", "compare-right", "compare-slider", "error-gain"].map(found);
  const [stage, errorStage] = ["compare-stage", "error-stage"].map(found);
  const [leftImage, rightImage, errorImage] = ["compare-left-image", "compare-right-image", "error-image"].map(found);
  const selects = { scene: sceneSelect, seed: seedSelect, map: mapSelect, view: viewSelect, left: leftSelect, right: rightSelect };
  const TRUTH = "truth";
  const LINK = "#browse:";
  const rowValue = (row) => `row ${row}`; // no row's key is the word for the truth
  const kept = data.runs.filter((run) => sheets.has(run.key));
  let runs = kept;

  const unique = (values) => [...new Set(values)];
  const named = (values) => values.map((value) => [String(value), String(value)]);
  const here = () => runs.filter((run) => run.scene === sceneSelect.value && String(run.seed) === seedSelect.value);
  const ofRow = (value) => here().find((run) => rowValue(run.row) === value);
  const right = () => ofRow(rightSelect.value);
  const view = () => Number(viewSelect.value);
  const map = () => mapSelect.value;
  const viewName = (place) => here()[0].views?.[place] ?? here()[0].view;
  const shownView = (run) => Math.max(0, (run.views ?? []).indexOf(run.view));

  function value(run, place = view(), name = map()) { // the metric of this map and view, as text
    const column = data.columns.find((each) => each.key === data.maps[name].metric);
    const number = column && run.by_view?.[column.key]?.[place];
    return typeof number === "number" ? `${column.label} ${number.toFixed(column.decimals)}${column.unit ? ` ${column.unit}` : ""}` : "";
  }

  function offer() { // what there is of the chosen scene and seed; choices stay where they are still there
    fill(sceneSelect, named(unique(runs.map((run) => run.scene))));
    fill(seedSelect, named(unique(runs.filter((run) => run.scene === sceneSelect.value).map((run) => run.seed))));
    const rows = here().map((run) => [rowValue(run.row), texts[run.row]]);
    fill(rightSelect, rows);
    fill(leftSelect, [[TRUTH, "ground truth"], ...rows]);
    fill(mapSelect, Object.entries(data.maps).filter(([name]) => here().some((run) => sheets.mapsOf(run.key).includes(name))).map(([name, each]) => [name, each.label]));
    const before = viewSelect.value;
    const places = unique(here().flatMap((run) => sheets.viewsOf(run.key, map(), "mine"))).sort((one, other) => one - other);
    fill(viewSelect, places.map((place) => [String(place), viewName(place)]));
    if (viewSelect.value !== before) viewSelect.value = String(places.includes(shownView(here()[0])) ? shownView(here()[0]) : places[0]);
    for (const select of [sceneSelect, seedSelect]) select.parentElement.hidden = select.options.length < 2;
  }

  function gainOf(run) { // what the errors are multiplied by before they are coloured
    if (gainSelect.value !== "auto") return Number(gainSelect.value);
    const sheet = sheets.sizeOf(run.key, map(), "error", view());
    return sheet ? 1 / Math.max(sheet.tops[sheet.views.indexOf(view())], 1 / 255) : 1;
  }

  function show() {
    const [mine, left] = [right(), leftSelect.value];
    const other = left === TRUTH ? mine : ofRow(left);
    const side = left === TRUTH ? "truth" : "mine";
    const { label, unit, range } = data.maps[map()];
    const leftName = left === TRUTH ? "ground truth" : texts[other.row];
    const there = sheets.sizeOf(other.key, map(), side, view()) !== undefined;
    const known = sheets.sizeOf(mine.key, map(), "error", view()) !== undefined;
    const size = sheets.sizeOf(mine.key, map(), "mine", view());
    sheets.draw(rightImage, mine.key, map(), "mine", view(), `${label}, ${texts[mine.row]}, ${viewName(view())}`);
    sheets.draw(leftImage, other.key, map(), side, view(), `${label}, ${leftName}, ${viewName(view())}`);
    sheets.draw(errorImage, mine.key, map(), "error", view(), `error of ${label}, ${texts[mine.row]}, ${viewName(view())}`);
    found("error-none").hidden = known;
    const gain = gainOf(mine);
    for (const each of found("error-slope").children) each.setAttribute("slope", gain);
    found("error-unit").textContent = unit.replace("{}", String(Number((range / gain).toPrecision(2))));
    found("compare-left-name").textContent = `◀ ${there ? leftName : `n/a: ${left === TRUTH ? "no ground truth for this map" : `${leftName} has no such map`}`}`;
    found("compare-right-name").textContent = `${size ? [texts[mine.row], value(mine)].filter(Boolean).join(", ") : `n/a: ${texts[mine.row]} has no such map`} ▶`;
    const seed = seedSelect.options.length > 1 ? `, seed ${mine.seed}` : "";
    found("browse-said").textContent = `${mine.scene}${seed}, ${viewName(view())}: ${label}`;
    if (size) for (const each of [stage, errorStage]) each.style.aspectRatio = `${size.width} / ${size.height}`;
    document.dispatchEvent(new Event("browse"));
  }

  function slide() {
    const share = Number(slider.value);
    found("compare-clip").style.clipPath = `inset(0 ${100 - share}% 0 0)`;
    found("compare-edge").style.left = `${share}%`;
  }

  function step(select, by) { // to the next choice, round from the last to the first
    const count = select.options.length;
    select.selectedIndex = (select.selectedIndex + by + count) % count;
    select.dispatchEvent(new Event("change"));
  }

  function choose(choices) { // by name, as in `selects`; what is not offered leaves the choice as it was
    for (const [name, select] of Object.entries(selects)) {
      if ([...select.options].some((option) => option.value === String(choices[name]))) select.value = String(choices[name]);
      offer();
    }
    show();
  }

  function remember() { // in the address, so that it can be kept or sent
    const chosen = Object.entries(selects).map(([name, select]) => [name, select.value]);
    history.replaceState(null, "", `${LINK}${new URLSearchParams(chosen)}`);
  }

  function recall() {
    if (!location.hash.startsWith(LINK)) return;
    choose(Object.fromEntries(new URLSearchParams(location.hash.slice(LINK.length))));
    found("images").scrollIntoView();
  }

  function follow() {
    const ticked = kept.filter((run) => shared.selection().holds(run));
    found("compare-none").hidden = ticked.length > 0;
    runs = ticked.length ? ticked : kept;
    offer();
    show();
  }

  zooming([stage, errorStage], [leftImage, rightImage, errorImage], {
    slide(pressed, share) {
      if (pressed !== stage) return;
      slider.value = 100 * Math.min(1, Math.max(0, share));
      slide();
    },
    arrow: (key) => ({ ArrowLeft: () => step(viewSelect, -1), ArrowRight: () => step(viewSelect, 1), ArrowUp: () => step(rightSelect, -1), ArrowDown: () => step(rightSelect, 1) })[key](),
  });
  document.addEventListener("selection", follow);
  for (const select of Object.values(selects)) {
    select.addEventListener("change", () => {
      offer();
      show();
      remember();
    });
  }
  addEventListener("hashchange", recall);
  slider.addEventListener("input", slide);
  gainSelect.addEventListener("change", show);
  found("view-before").addEventListener("click", () => step(viewSelect, -1));
  found("view-after").addEventListener("click", () => step(viewSelect, 1));
  document.addEventListener("showcell", (event) => {
    const run = kept.find((each) => each.key === event.detail);
    if (!runs.includes(run)) runs = kept;
    offer();
    choose({ scene: run.scene, seed: run.seed, right: rowValue(run.row) });
    found("images").scrollIntoView();
    rightSelect.focus();
  });
  function start() {
    follow();
    slide();
    recall();
  }

  function chooseAndRemember(choices) {
    choose(choices);
    remember();
  }

  return { start, here, right, view, map, value, viewName, choose: chooseAndRemember, rowValue };
})();

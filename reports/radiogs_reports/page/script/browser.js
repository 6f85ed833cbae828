// The scene, seed, view, map and light of the page's pictures, and two of them under a slider, with the error beside them.
const browser = (() => {
  const { data, texts, fill, say, printed } = shared;
  const found = (name) => document.getElementById(name);
  if (!found("images")) return null; // no cell keeps pictures, or none is finished
  const [sceneSelect, seedSelect, viewSelect, mapSelect, lightSelect] = ["browse-scene", "browse-seed", "browse-view", "browse-map", "browse-light"].map(found);
  const [leftSelect, rightSelect, slider, gainSelect] = ["compare-left", "compare-right", "compare-slider", "error-gain"].map(found);
  const [stage, errorStage] = ["compare-stage", "error-stage"].map(found);
  const [leftImage, rightImage, errorImage] = ["compare-left-image", "compare-right-image", "error-image"].map(found);
  const selects = { scene: sceneSelect, seed: seedSelect, map: mapSelect, light: lightSelect, view: viewSelect, left: leftSelect, right: rightSelect };
  const TRUTH = "truth";
  const LINK = "#browse:";
  const GAINS = [64, 32, 16, 8, 4, 2, 1];
  const rowValue = (row) => `row ${row}`; // no row's key is the word for the truth
  const kept = data.runs.filter((run) => sheets.has(run.key));
  let runs = kept;

  const unique = (values) => [...new Set(values)];
  const named = (values) => values.map((value) => [String(value), String(value)]);
  const here = () => runs.filter((run) => run.scene === sceneSelect.value && String(run.seed) === seedSelect.value);
  const ofRow = (value) => here().find((run) => rowValue(run.row) === value);
  const right = () => ofRow(rightSelect.value);
  const view = () => Number(viewSelect.value);
  const [kindOf, lightOf] = [(name) => name.split("/", 1)[0], (name) => name.split("/").slice(1).join("/")];
  const under = (kind) => (data.maps[`${kind}/${lightSelect.value}`] ? `${kind}/${lightSelect.value}` : kind); // the chosen light
  const map = () => under(mapSelect.value);
  const choiceOf = (name) => ({ map: kindOf(name), ...(lightOf(name) ? { light: lightOf(name) } : {}) });
  const label = (name) => [data.maps[name].label, lightOf(name)].filter(Boolean).join(" under ");
  const viewName = (place) => here()[0].views?.[place] ?? here()[0].view;
  const shownView = (run) => Math.max(0, (run.views ?? []).indexOf(run.view));

  function value(run, place = view(), name = map()) { // the metric of this map and view, as text
    const column = data.columns.find((each) => each.key === data.maps[name].metric);
    const number = column && run.by_view?.[column.key]?.[place];
    return typeof number === "number" ? `${column.label} ${printed(number, column.decimals)}${column.unit ? ` ${column.unit}` : ""}` : "";
  }

  function offer() { // what there is of the chosen scene and seed; choices stay where they are still there
    fill(sceneSelect, named(unique(runs.map((run) => run.scene))));
    fill(seedSelect, named(unique(runs.filter((run) => run.scene === sceneSelect.value).map((run) => run.seed))));
    const rows = here().map((run) => [rowValue(run.row), texts[run.row]]);
    fill(rightSelect, rows);
    fill(leftSelect, [[TRUTH, "ground truth"], ...rows]);
    const maps = Object.keys(data.maps).filter((name) => here().some((run) => sheets.mapsOf(run.key).includes(name)));
    fill(mapSelect, unique(maps.map(kindOf)).map((kind) => [kind, data.maps[maps.find((name) => kindOf(name) === kind)].label]));
    const lit = lightSelect.value;
    fill(lightSelect, named(unique(maps.map(lightOf)).filter(Boolean)));
    if (!lit && maps.some((name) => lightOf(name) === here()[0].light)) lightSelect.value = here()[0].light;
    const before = viewSelect.value;
    const places = unique(here().flatMap((run) => sheets.viewsOf(run.key, map(), "mine"))).sort((one, other) => one - other);
    fill(viewSelect, places.map((place) => [String(place), viewName(place)]));
    if (viewSelect.value !== before) viewSelect.value = String(places.includes(shownView(here()[0])) ? shownView(here()[0]) : places[0]);
    for (const select of [sceneSelect, seedSelect, lightSelect]) select.parentElement.hidden = select.options.length < 2;
  }

  function gain() { // of errors before they are coloured, for all rows: by `auto` the largest that shows 99 % of each one's
    if (gainSelect.value !== "auto") return Number(gainSelect.value);
    const known = here().map((run) => sheets.sizeOf(run.key, map(), "error", view())).filter(Boolean);
    const largest = Math.max(...known.map((sheet) => sheet.tops[sheet.views.indexOf(view())]));
    return GAINS.find((each) => each * largest <= 1) ?? 1;
  }

  function lines() { // of the strip: the maps of a picture, of its error and of a relit picture, and how they are called
    const [relit, times] = [under("relit"), gain()];
    const { unit, range } = data.maps[map()];
    const scale = unit.replace("{}", String(Number((range / times).toPrecision(2))));
    const named = [label(map()), `its error times ${times} (${scale})`, ...(data.maps[relit] && relit !== map() ? [label(relit)] : [])];
    return { named, scale, relit: named[2] && relit };
  }

  function show() {
    const [mine, left] = [right(), leftSelect.value];
    const other = left === TRUTH ? mine : ofRow(left);
    const side = left === TRUTH ? "truth" : "mine";
    const leftName = left === TRUTH ? "ground truth" : texts[other.row];
    const there = sheets.sizeOf(other.key, map(), side, view()) !== undefined;
    const known = sheets.sizeOf(mine.key, map(), "error", view()) !== undefined;
    const size = sheets.sizeOf(mine.key, map(), "mine", view());
    sheets.draw(rightImage, mine.key, map(), "mine", view(), `${label(map())}, ${texts[mine.row]}, ${viewName(view())}`);
    sheets.draw(leftImage, other.key, map(), side, view(), `${label(map())}, ${leftName}, ${viewName(view())}`);
    sheets.draw(errorImage, mine.key, map(), "error", view(), `error of ${label(map())}, ${texts[mine.row]}, ${viewName(view())}`);
    found("error-none").hidden = known;
    const { named: told, scale } = lines();
    for (const each of found("error-slope").children) each.setAttribute("slope", gain());
    found("error-unit").textContent = scale;
    say(found("compare-left-name"), `◀ ${there ? leftName : `n/a: ${left === TRUTH ? "no ground truth for this map" : `${leftName} has no such map`}`}`);
    say(found("compare-right-name"), `${size ? [texts[mine.row], value(mine)].filter(Boolean).join(", ") : `n/a: ${texts[mine.row]} has no such map`} ▶`);
    const seed = seedSelect.options.length > 1 ? `, seed ${mine.seed}` : "";
    found("browse-said").textContent = `${mine.scene}${seed}, ${viewName(view())}; from top to bottom: ${told.join("; ")}`;
    if (size) for (const each of [stage, errorStage]) each.style.aspectRatio = `${size.width} / ${size.height}`;
    tell();
    document.dispatchEvent(new Event("browse"));
  }

  function tell() { // the plot of views and the 3-D view of the scene and seed that were chosen
    const [first, second] = here();
    for (const [id, value] of [["views-scene", first.scene], ["surfels-left", first.key], ["surfels-right", second?.key ?? ""]]) {
      const select = found(id);
      if (!select?.value || here().some((run) => [run.scene, run.key].includes(select.value)) || ![...select.options].some((each) => each.value === value)) continue;
      select.value = value;
      select.dispatchEvent(new Event("change"));
    }
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
    remember();
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
  for (const select of Object.values(selects)) select.addEventListener("change", () => choose({}));
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

  return { start, here, right, view, map, label, lines, choiceOf, value, viewName, choose, rowValue };
})();

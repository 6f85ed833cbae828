// Small pictures below the comparison: every row, every view or every map; a click shows one on the right side.
(() => {
  if (!browser) return;
  const { data, texts, element } = shared;
  const box = document.getElementById("gallery");
  const [ofSelect, errors] = ["gallery-of", "gallery-errors"].map((name) => document.getElementById(name));

  function ofRows() {
    const view = browser.view();
    const map = browser.map();
    const rows = browser.here().map((run) => ({
      run, map, view, side: "mine", name: texts[run.row], value: browser.value(run), chosen: run === browser.right(),
      choice: { right: browser.rowValue(run.row) },
    }));
    const truth = browser.here().find((run) => sheets.viewsOf(run.key, map, "truth").includes(view));
    if (!truth || errors.checked) return rows;
    return [{ run: truth, map, view, side: "truth", name: "ground truth", value: "", chosen: false, choice: { left: "truth" } }, ...rows];
  }

  function ofViews() {
    const run = browser.right();
    return sheets.viewsOf(run.key, browser.map(), "mine").map((view) => ({
      run, map: browser.map(), view, side: "mine", name: browser.viewName(view), value: browser.value(run, view),
      chosen: view === browser.view(), choice: { view },
    }));
  }

  function ofMaps() {
    const run = browser.right();
    return sheets.mapsOf(run.key).filter((map) => sheets.viewsOf(run.key, map, "mine").includes(browser.view())).map((map) => ({
      run, map, view: browser.view(), side: "mine", name: data.maps[map].label, value: browser.value(run, browser.view(), map),
      chosen: map === browser.map(), choice: { map },
    }));
  }

  function tile(each) {
    const made = element("button", undefined, "tile");
    made.type = "button";
    made.setAttribute("aria-pressed", String(each.chosen));
    const canvas = element("canvas");
    canvas.setAttribute("role", "img");
    canvas.classList.toggle("error", errors.checked);
    const side = errors.checked ? "error" : each.side;
    const size = sheets.sizeOf(each.run.key, each.map, side, each.view);
    if (size) [canvas.width, canvas.height] = [size.width, size.height];
    made.append(canvas, element("span", each.name), element("span", size ? each.value : "n/a", "hint"));
    made.addEventListener("click", () => browser.choose(each.choice));
    made.draw = () => sheets.draw(canvas, each.run.key, each.map, side, each.view, `${each.name}${errors.checked ? ", error" : ""}`);
    return made;
  }

  function show() {
    const focused = [...box.children].indexOf(document.activeElement);
    const tiles = { rows: ofRows, views: ofViews, maps: ofMaps }[ofSelect.value]().map(tile);
    box.replaceChildren(...tiles);
    requestIdleCallback(() => tiles.forEach((each) => each.draw())); // the comparison above comes first
    if (focused >= 0) box.children[Math.min(focused, box.children.length - 1)].focus();
  }

  for (const each of [ofSelect, errors]) each.addEventListener("change", show);
  document.addEventListener("browse", show);
  browser.start();
})();

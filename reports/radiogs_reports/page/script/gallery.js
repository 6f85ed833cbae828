// Small pictures: the strip below the table, and every view or map below the comparison. A click shows one on the right side.
(() => {
  if (!browser) return;
  const { texts, element, formula } = shared;
  const [strip, gallery, ofSelect, errors] = ["strip", "gallery", "gallery-of", "gallery-errors"].map((name) => document.getElementById(name));

  function ofRows() { // the truth and every row: picture, error, relit
    const [map, view] = [browser.map(), browser.view()];
    const { relit } = browser.lines();
    const pictures = (...sides) => [[map, sides[0], view], [map, sides[1], view], ...(relit ? [[relit, sides[0], view]] : [])];
    const rows = browser.here().map((run) => ({
      run, name: texts[run.row], value: browser.value(run), chosen: run === browser.right(), pictures: pictures("mine", "error"),
      choice: { right: browser.rowValue(run.row) },
    }));
    const truth = browser.here().find((run) => sheets.viewsOf(run.key, map, "truth").includes(view));
    if (!truth) return rows;
    return [{ run: truth, name: "ground truth", value: "", chosen: false, pictures: pictures("truth", "none"), choice: { left: "truth" } }, ...rows];
  }

  function ofRight() { // every view, or every map, of the right side
    const [run, side] = [browser.right(), errors.checked ? "error" : "mine"];
    const has = (map, view) => sheets.viewsOf(run.key, map, "mine").includes(view);
    const shown = ofSelect.value === "views"
      ? sheets.viewsOf(run.key, browser.map(), "mine").map((view) => [browser.map(), view, browser.viewName(view), { view }])
      : sheets.mapsOf(run.key).filter((map) => has(map, browser.view())).map((map) => [map, browser.view(), browser.label(map), browser.choiceOf(map)]);
    return shown.map(([map, view, name, choice]) => ({
      run, name, value: browser.value(run, view, map), chosen: map === browser.map() && view === browser.view(), pictures: [[map, side, view]], choice,
    }));
  }

  function tile({ run, name, value, chosen, pictures, choice }) {
    const made = element("button", undefined, "tile");
    made.type = "button";
    made.setAttribute("aria-pressed", String(chosen));
    const canvases = pictures.map(([map, side, view]) => {
      const canvas = element("canvas", undefined, side === "error" ? "error" : "");
      canvas.setAttribute("role", "img");
      const size = sheets.sizeOf(run.key, map, side, view) ?? sheets.sizeOf(run.key, map, "mine", view);
      if (size) [canvas.width, canvas.height] = [size.width, size.height];
      return canvas;
    });
    const [title, [map, side, view]] = [element("span"), pictures[0]];
    title.append(formula(name));
    made.append(title, ...canvases, element("span", sheets.sizeOf(run.key, map, side, view) ? value : "n/a", "hint"));
    made.addEventListener("click", () => browser.choose(choice));
    made.draw = () => pictures.forEach((each, place) => sheets.draw(canvases[place], run.key, ...each, `${browser.label(each[0])}${each[1] === "error" ? ", error" : ""}`));
    return made;
  }

  function show(box, entries) {
    const focused = [...box.children].indexOf(document.activeElement);
    const tiles = entries.map(tile);
    box.replaceChildren(...tiles);
    requestIdleCallback(() => tiles.forEach((each) => each.draw())); // the comparison comes first
    if (focused >= 0) box.children[Math.min(focused, box.children.length - 1)].focus();
  }

  for (const each of [ofSelect, errors]) each.addEventListener("change", () => show(gallery, ofRight()));
  document.addEventListener("browse", () => {
    show(strip, ofRows());
    show(gallery, ofRight());
  });
  browser.start();
})();

// What several scripts use: the data of the page, elements, and the colours of rows.
const shared = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const texts = Object.fromEntries(data.rows.map((row) => [row.key, row.text]));
  const places = Object.fromEntries(data.rows.map((row, place) => [row.key, place]));
  const ALL = { whole: true, holds: () => true, rows: () => true };
  let selection = ALL;

  function element(name, text, className) {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  }

  function fill(select, entries) { // keeps the choice where it is still offered
    const before = select.value;
    select.replaceChildren(
      ...entries.map(([value, text]) => Object.assign(element("option", text), { value })),
    );
    if (entries.some(([value]) => value === before)) select.value = before;
  }

  function formula(text) { // nodes, with indices and exponents of symbols such as L_G^PBR set as such
    const made = document.createDocumentFragment();
    text.split(new RegExp(data.symbol)).forEach((part, place) => part && made.append(place % 4 ? element(["i", "sub", "sup"][(place % 4) - 1], part) : part));
    return made;
  }

  const say = (place, text) => place.replaceChildren(formula(text));
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colourOf = (row) => colour(`--row-${places[row] % 8}`);
  const hollow = (row) => Math.floor(places[row] / 8) % 2 === 1; // colours come round again after eight rows
  const nameOf = (run) => run.name ?? `${texts[run.row]}, ${run.scene}, seed ${run.seed}`;

  function legend(list, rows) {
    list.replaceChildren(...rows.map((row) => {
      const [item, dot] = [element("li"), element("span", undefined, "dot")];
      Object.assign(dot.style, { borderColor: colourOf(row.key), backgroundColor: hollow(row.key) ? "transparent" : colourOf(row.key) });
      item.append(dot, formula(row.text));
      return item;
    }));
  }

  function drawnAnew(box, draw) { // now, and when the width, the colours or the ticked cells change
    let width = box.clientWidth;
    for (const name of ["themechange", "selection"]) document.addEventListener(name, draw);
    new ResizeObserver(() => {
      if (box.clientWidth === width) return;
      width = box.clientWidth;
      draw();
    }).observe(box);
    draw();
  }

  function arrows(box, count, current, show) { // the left and right keys go from mark to mark, round at the ends
    box.onkeydown = (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (event.key === "Escape") show(-1);
      if (!step) return;
      event.preventDefault();
      show(current() < 0 && step < 0 ? count - 1 : (current() + step + count) % count);
    };
  }

  const axis = (label, rest) => ({ // of a plot
    stroke: colour("--ink"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line") }, label, labelSize: 26, ...rest,
  });
  const titled = (column) => (column.unit ? `${column.label}, ${column.unit}` : column.label);
  const mean = (values) => (values.length ? values.reduce((sum, each) => sum + each, 0) / values.length : null);
  function grouped(items, key) {
    const groups = new Map();
    for (const item of items) groups.set(key(item), [...(groups.get(key(item)) ?? []), item]);
    return [...groups.values()];
  }
  function meanOf(runs, value) { // over kinds of scenes, of means over their scenes, of means over those' seeds
    const every = runs.filter((run) => typeof value(run) === "number");
    const counted = every.filter((run) => data.counted.includes(run.scene)); // others only where they are alone
    const known = counted.length ? counted : every;
    const overScenes = (held) => mean(grouped(held, (run) => run.scene).map((own) => mean(own.map(value))));
    return mean(grouped(known, (run) => data.kinds[run.scene] ?? "").map(overScenes));
  }
  function printed(value, decimals) { // two significant digits where the decimals would all be 0
    const text = value.toFixed(decimals);
    return Number(text) === 0 && value !== 0 ? String(Number(value.toPrecision(2))) : text;
  }
  const numbers = (values) => values.filter((each) => typeof each === "number");

  return {
    data, texts, element, fill, formula, say, colour, colourOf, hollow, nameOf, legend, drawnAnew, arrows, axis, titled, mean, meanOf, numbers, printed,
    selection: () => selection,
    select(chosen) {
      selection = chosen ?? ALL;
      document.dispatchEvent(new Event("selection"));
    },
  };
})();

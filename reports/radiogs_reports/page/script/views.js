// A metric view by view, a line for each row: where methods differ, and which views are hard for all of them.
(() => {
  const box = document.getElementById("views-plot");
  if (!box) return; // no metric has values by view
  const { data, texts, fill, say, colourOf, hollow, legend, mean, numbers, printed } = shared;
  const [metricSelect, sceneSelect, orderSelect] = ["views-metric", "views-scene", "views-order"].map((name) => document.getElementById(name));
  const said = document.getElementById("views-said");
  let plot = null;

  const held = () => data.runs.filter((run) => run.by_view && shared.selection().holds(run));
  const columns = data.columns.filter((column) => data.runs.some((run) => run.by_view?.[column.key]));
  const scenes = [...new Set(data.runs.filter((run) => run.by_view).map((run) => run.scene))];

  function lines(column, scene) { // by row: the mean over seeds of each view
    const runs = held().filter((run) => run.scene === scene && run.by_view[column.key]);
    const names = runs.length ? runs[0].views : [];
    const rows = data.rows.filter((row) => runs.some((run) => run.row === row.key));
    const values = rows.map((row) => {
      const own = runs.filter((run) => run.row === row.key);
      return names.map((name, place) => mean(numbers(own.map((run) => run.by_view[column.key][place]))));
    });
    const order = names.map((name, place) => place).filter((place) => values.some((line) => line[place] !== null));
    if (orderSelect.value === "value") {
      const level = (place) => mean(numbers(values.map((line) => line[place])));
      order.sort((one, other) => level(one) - level(other));
    }
    return { rows, names: order.map((place) => names[place]), values: values.map((line) => order.map((place) => line[place])) };
  }

  function describe(drawn, column, place) {
    const best = column.direction === "up" ? -1 : 1;
    const found = drawn.rows.map((row, line) => [texts[row.key], drawn.values[line][place]]).filter(([, value]) => value !== null);
    found.sort((one, other) => best * (one[1] - other[1]));
    return `${drawn.names[place]}: ${found.map(([name, value]) => `${name} ${printed(value, column.decimals)}`).join(", ")}`;
  }

  function draw() {
    plot?.destroy();
    plot = null;
    const column = columns.find((each) => each.key === metricSelect.value);
    const drawn = lines(column, sceneSelect.value);
    legend(document.getElementById("views-legend"), drawn.rows);
    if (!drawn.names.length) {
      said.textContent = "No ticked cell of this scene has it by view.";
      return;
    }
    said.textContent = "";
    let place = -1;
    const show = (next) => {
      place = next;
      say(said, place < 0 ? "" : describe(drawn, column, place));
    };
    plot = new uPlot(
      {
        width: box.clientWidth,
        height: Math.min(360, Math.max(240, box.clientWidth * 0.4)),
        legend: { show: false },
        cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false, range: [-0.5, drawn.names.length - 0.5] } },
        axes: [
          shared.axis(orderSelect.value === "value" ? "views, lowest mean first" : "views, as stored", {
            incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500], values: (chart, splits) => splits.map((each) => drawn.names[each] ?? ""),
          }),
          shared.axis(shared.titled(column), { size: 64 }),
        ],
        series: [{}, ...drawn.rows.map((row) => ({
          label: row.text, stroke: colourOf(row.key), width: 1.5, dash: hollow(row.key) ? [5, 4] : undefined, points: { show: true, size: 6 },
        }))],
        hooks: { setCursor: [(chart) => { if (chart.cursor.idx !== null && chart.cursor.left >= 0) show(chart.cursor.idx); }] },
      },
      [drawn.names.map((name, place) => place), ...drawn.values],
      box,
    );
    shared.arrows(box, drawn.names.length, () => place, show);
  }

  fill(metricSelect, columns.map((column) => [column.key, column.label]));
  fill(sceneSelect, scenes.map((scene) => [scene, scene]));
  for (const select of [metricSelect, sceneSelect, orderSelect]) select.addEventListener("change", draw);
  shared.drawnAnew(box, draw);
})();

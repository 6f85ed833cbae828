// Quality against cost: rows as large marks with intervals and the front, cells as small marks; hover or arrow keys.
(() => {
  const { data, texts, element, fill, say, colour, colourOf, hollow, legend, meanOf, printed } = shared;
  const [box, said, qualitySelect, costSelect] = ["", "-said", "-quality", "-cost"].map((end) => document.getElementById(`scatter${end}`));
  if (!box) return; // nothing was trained
  const HOVER = 28; // pixels from a mark within which it is hovered
  const LOGARITHMIC_FROM = 8; // ratio of the largest to the smallest cost

  let plot = null;
  let marks = [];
  let current = -1;

  function partial(column, cost, holds) { // means of the ticked cells, which have no interval
    return data.rows.flatMap((row) => {
      const held = data.runs.filter((run) => run.row === row.key && holds(run));
      const [quality, spent] = [meanOf(held, (run) => run.metrics[column.key]), meanOf(held, (run) => run.cost[cost])];
      return quality === null || spent === null ? [] : [{ row: row.key, cost: spent, quality, half_width: null, on_front: false }];
    });
  }

  function collect(column, cost) {
    const { whole, holds } = shared.selection();
    const rows = (whole ? data.points[column.key][cost] : partial(column, cost, holds)).map((point) => ({ ...point, large: true }));
    const cells = data.runs
      .filter((run) => holds(run) && typeof run.metrics[column.key] === "number" && run.cost[cost] !== null)
      .map((run) => ({ row: run.row, cost: run.cost[cost], quality: run.metrics[column.key], run, large: false }));
    return [...rows, ...cells].sort((one, other) => one.cost - other.cost);
  }

  function digits(value) {
    return value >= 1000 ? Math.round(value).toLocaleString("en") : Number(value.toPrecision(4)).toString();
  }

  function describe(mark, column, cost) {
    const unit = column.unit ? ` ${column.unit}` : "";
    const name = mark.large ? `${texts[mark.row]}, mean` : `${texts[mark.row]}, ${mark.run.scene}, seed ${mark.run.seed}`;
    const interval = mark.large && mark.half_width !== null ? ` ± ${printed(mark.half_width, column.decimals)}` : "";
    const amount = cost === "seconds" ? `${digits(mark.cost)} s` : `${digits(mark.cost)} ${cost}`;
    const front = mark.large && mark.on_front ? "; on the front" : "";
    return `${name}: ${column.label} ${printed(mark.quality, column.decimals)}${interval}${unit} for ${amount}${front}`;
  }

  function seriesOf(large) {
    return data.rows.map((row) => ({
      label: row.text,
      paths: () => null,
      points: {
        show: true,
        size: large ? 12 : 6,
        width: large ? 3 : 1,
        stroke: colourOf(row.key),
        fill: large && !hollow(row.key) ? `${colourOf(row.key)}80` : "transparent", // a mark below another is seen
      },
    }));
  }

  function padded(low, high, logarithmic) {
    if (logarithmic) return [low / 1.15, high * 1.15];
    const room = (high - low || Math.abs(high) || 1) * 0.1;
    return [low - room, high + room];
  }

  function ticks(low, high) { // 1, 2 and 5 of each decade: powers of ten alone may be one or none
    const found = [];
    for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1) {
      found.push(...[1, 2, 5].map((digit) => Number(`${digit}e${power}`)).filter((each) => low <= each && each <= high));
    }
    return found;
  }

  function drawLines(chart) { // the intervals of rows, and the front
    const { ctx: context, bbox: { left, top, width: across, height: tall } } = chart;
    const line = (look, points) => {
      context.strokeStyle = look;
      context.beginPath();
      for (const point of points) context.lineTo(chart.valToPos(point.cost, "x", true), chart.valToPos(point.quality, "y", true));
      context.stroke();
    };
    context.save();
    context.beginPath();
    context.rect(left, top, across, tall);
    context.clip(); // a bar may be longer than the plot is high
    context.lineWidth = devicePixelRatio;
    for (const mark of marks.filter((each) => each.large && each.half_width !== null)) {
      line(colourOf(mark.row), [-1, 1].map((side) => ({ ...mark, quality: mark.quality + side * mark.half_width })));
    }
    context.setLineDash([4 * devicePixelRatio, 4 * devicePixelRatio]);
    line(colour("--faint"), marks.filter((mark) => mark.large && mark.on_front));
    context.restore();
  }

  function show(place, column, cost) {
    current = place;
    const tip = box.querySelector(".tip");
    const ring = box.querySelector(".ring");
    tip.hidden = ring.hidden = place < 0;
    if (place < 0) return;
    const mark = marks[place];
    const across = plot.valToPos(mark.cost, "x");
    const down = plot.valToPos(mark.quality, "y");
    say(tip, describe(mark, column, cost));
    ring.style.transform = `translate(${across}px, ${down}px)`;
    const room = plot.over.clientWidth - tip.offsetWidth;
    const below = down < tip.offsetHeight + 20; // near the upper edge the text goes below the mark
    tip.style.transform = `translate(${Math.max(0, Math.min(room, across - tip.offsetWidth / 2))}px, ${below ? down + 14 : down - tip.offsetHeight - 14}px)`;
  }

  function nearest(event) {
    const frame = plot.over.getBoundingClientRect();
    let best = -1;
    let least = HOVER;
    marks.forEach((mark, place) => {
      const across = plot.valToPos(mark.cost, "x") - (event.clientX - frame.left);
      const down = plot.valToPos(mark.quality, "y") - (event.clientY - frame.top);
      const distance = Math.hypot(across, down);
      if (distance < least) [best, least] = [place, distance];
    });
    return best;
  }

  function draw() {
    const column = data.columns.find((each) => each.key === qualitySelect.value);
    const cost = costSelect.value;
    plot?.destroy();
    plot = null;
    legend(document.getElementById("scatter-legend"), data.rows.filter((row) => shared.selection().rows(row.key)));
    said.textContent = "";
    marks = collect(column, cost);
    current = -1;
    if (!marks.length) {
      said.textContent = `No cell has both ${column.label} and ${data.costs[cost]}.`;
      return;
    }
    const costs = marks.map((mark) => mark.cost);
    const [low, high] = [costs[0], costs[costs.length - 1]];
    const logarithmic = high / low >= LOGARITHMIC_FROM;
    const qualities = marks.map((mark) => mark.quality); // not the bars: with few pairs they dwarf what was measured
    const values = (large) =>
      data.rows.map((row) => marks.map((mark) => (mark.large === large && mark.row === row.key ? mark.quality : null)));
    const ticked = logarithmic ? { splits: (chart, place, from, to) => ticks(from, to), filter: (chart, splits) => splits } : {};
    const better = { up: "higher is better", down: "lower is better", zero: "closer to zero is better" }[column.direction];
    plot = new uPlot(
      {
        width: box.clientWidth,
        height: Math.min(440, Math.max(280, box.clientWidth * 0.55)),
        legend: { show: false },
        cursor: { show: false },
        scales: {
          x: { time: false, distr: logarithmic ? 3 : 1, range: padded(low, high, logarithmic) },
          y: { range: padded(Math.min(...qualities), Math.max(...qualities), false) },
        },
        axes: [
          shared.axis(data.costs[cost], { ...ticked, values: (chart, splits) => splits.map((each) => (each === null ? "" : digits(each))) }),
          shared.axis(`${shared.titled(column)} (${better})`, { size: 64 }),
        ],
        series: [{}, ...seriesOf(false), ...seriesOf(true)],
        hooks: { drawAxes: [drawLines] },
      },
      [costs, ...values(false), ...values(true)],
      box,
    );
    plot.over.append(...["ring", "tip"].map((name) => Object.assign(element("div", undefined, name), { hidden: true })));
    const hover = (event) => show(nearest(event), column, cost);
    plot.over.addEventListener("pointermove", hover);
    plot.over.addEventListener("pointerdown", hover);
    plot.over.addEventListener("pointerleave", () => show(-1, column, cost));
    shared.arrows(box, marks.length, () => current, (place) => {
      show(place, column, cost);
      if (place >= 0) say(said, describe(marks[place], column, cost));
    });
  }

  fill(qualitySelect, data.columns.map((column) => [column.key, column.label]));
  fill(costSelect, Object.entries(data.costs));
  qualitySelect.addEventListener("change", draw);
  costSelect.addEventListener("change", draw);
  shared.drawnAnew(box, draw);
})();

// The suite's table and that of cells follow the selection: means over the ticked cells, without what needs all of them.
(() => {
  const { data, meanOf, printed } = shared;
  const table = document.querySelector('table[data-name="means"]');
  const cells = document.querySelector('table[data-name="cells"]');
  const runs = new Map(data.runs.map((run) => [run.key, run]));
  const stored = new Map();

  function keep(cell) {
    if (!stored.has(cell)) stored.set(cell, { content: [...cell.childNodes], names: cell.className, data: { ...cell.dataset } });
  }

  function restore() {
    for (const [cell, { content, names, data: values }] of stored) {
      cell.replaceChildren(...content);
      cell.className = names;
      Object.assign(cell.dataset, values);
    }
    stored.clear();
  }

  function put(cell, value, column) {
    keep(cell);
    for (const name of ["value", "difference", "published"]) delete cell.dataset[name];
    cell.className = "number";
    cell.replaceChildren(value === null ? "n/a" : printed(value, column.decimals));
    if (value !== null) cell.dataset.value = column.direction === "zero" ? Math.abs(value) : value;
  }

  const valueOf = (run, column) => (column.key === "seconds" ? run.cost.seconds : run.metrics[column.key]);

  function follow() {
    const { whole, holds, rows } = shared.selection();
    restore();
    document.getElementById("means-partial").hidden = whole;
    for (const line of cells.tBodies[0].rows) line.hidden = !holds(runs.get(line.querySelector("button.open").dataset.key));
    for (const line of table.tBodies[0].rows) {
      const { row } = line.cells[0].dataset;
      line.hidden = !rows(row);
      if (whole) continue;
      const held = data.runs.filter((run) => run.row === row && holds(run));
      data.table.forEach((column, place) => put(line.cells[place + 1], meanOf(held, (run) => valueOf(run, column)), column));
    }
  }

  document.addEventListener("selection", follow);
})();

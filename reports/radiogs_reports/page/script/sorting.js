// Tables sort by a click on a heading: best first, then in reverse. Missing values stay last both ways.
(() => {
  function valueOf(row, place, by) {
    const { dataset: { [by]: text = null }, classList } = row.cells[place];
    return text !== null && classList.contains("number") ? Number(text) : text;
  }

  function compare(first, second) {
    if (typeof first === "number") return first - second;
    return first.localeCompare(second, "en", { numeric: true });
  }

  function sort(table, place, descending, asked) {
    const body = table.tBodies[0];
    const rows = [...body.rows];
    const has = rows.some((row) => row.cells[place].dataset[asked] !== undefined);
    const by = has ? asked : "value"; // a column without published values sorts by its measured ones
    const sign = descending ? -1 : 1;
    rows.sort((one, other) => {
      const first = valueOf(one, place, by);
      const second = valueOf(other, place, by);
      if (first === null || second === null) return (first === null) - (second === null);
      return sign * compare(first, second);
    });
    body.append(...rows);
    [...table.tHead.rows[0].cells].forEach((head, other) => {
      if (other === place) head.setAttribute("aria-sort", descending ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    const select = document.querySelector(`select.sort-by[data-table="${table.dataset.name}"]`);
    const asked = () => (select ? select.value : "value");
    heads.forEach((head, place) => {
      head.querySelector("button").addEventListener("click", () => {
        const sorted = head.getAttribute("aria-sort");
        const bestIsHigh = head.textContent.includes("↑");
        sort(table, place, sorted === null ? bestIsHigh : sorted === "ascending", asked());
      });
    });
    select?.addEventListener("change", () => {
      const place = heads.findIndex((head) => head.hasAttribute("aria-sort"));
      if (place >= 0) sort(table, place, heads[place].getAttribute("aria-sort") === "descending", asked());
    });
  }
})();

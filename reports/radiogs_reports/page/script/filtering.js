// Choices above the site's table hide the rows that have another text in that column.
(() => {
  const bar = document.getElementById("filters");
  const table = document.querySelector("table.sortable");
  const rows = [...table.tBodies[0].rows];
  const heads = [...table.tHead.rows[0].cells].map((head) => head.textContent.trim());
  const said = bar.appendChild(document.createElement("span"));
  const chosen = new Map();

  function apply() {
    for (const row of rows) row.hidden = [...chosen].some(([place, select]) => select.value && row.cells[place].dataset.value !== select.value);
    said.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} lines`;
  }

  for (const name of bar.dataset.columns.split(" ")) {
    const place = heads.indexOf(name);
    const texts = [...new Set(rows.map((row) => row.cells[place].dataset.value ?? ""))].filter(Boolean).sort();
    if (texts.length < 2) continue;
    const [label, select] = [document.createElement("label"), document.createElement("select")];
    select.append(new Option("all", ""), ...texts.map((text) => new Option(text, text)));
    select.addEventListener("change", apply);
    label.append(name, select);
    said.before(label);
    chosen.set(place, select);
  }
  apply();
})();

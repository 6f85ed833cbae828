// Boxes for scenes, seeds and rows: tables, plots and images show the cells that are ticked.
(() => {
  const bar = document.getElementById("selection");
  if (!bar) return; // one scene, one seed and one row
  const { data, select } = shared;
  const boxes = [...bar.querySelectorAll("input")];
  const said = document.getElementById("selection-said");

  function ticked(name) {
    const group = boxes.filter((box) => box.name === name);
    const values = new Set(group.filter((box) => box.checked).map((box) => box.value));
    return (value) => !group.length || values.has(String(value));
  }

  function tell() {
    const whole = boxes.every((box) => box.checked);
    const [scenes, seeds, rows] = ["scene", "seed", "row"].map(ticked);
    const holds = (run) => scenes(run.scene) && seeds(run.seed) && rows(run.row);
    said.textContent = `${data.runs.filter(holds).length} of ${data.runs.length} cells are shown.`;
    select(whole ? null : { whole, holds, rows });
  }

  for (const box of boxes) box.addEventListener("change", tell);
  for (const button of bar.querySelectorAll("button")) {
    button.addEventListener("click", () => { // all of a group, or if they are all ticked, none
      const group = boxes.filter((box) => box.name === button.value);
      const tick = !group.every((box) => box.checked);
      for (const box of group) box.checked = tick;
      tell();
    });
  }
  tell(); // a browser may have kept the boxes of an earlier visit
})();

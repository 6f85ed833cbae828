// Pictures of cells: each lies on a sheet with other views of its map. A sheet is read when one of its pictures is shown.
const sheets = (() => {
  const { data } = shared;
  const MOST = 96; // decoded sheets that are kept
  const cells = new Map();
  const images = new Map();
  const wanted = new WeakMap(); // what each canvas shows last, because sheets may come late

  function cell(key) {
    if (!cells.has(key)) {
      const place = document.getElementById(`sheets-${key}`);
      cells.set(key, place && JSON.parse(place.textContent));
    }
    return cells.get(key);
  }

  function address(name) {
    const inside = document.getElementById(`sheet-${name}`);
    return inside ? `data:image/webp;base64,${inside.textContent}` : `${data.files.folder}/${name}${data.files.kind}`;
  }

  function read(name) {
    const image = images.get(name) ?? new Promise((resolve, reject) => {
      const made = new Image();
      made.onload = () => resolve(made);
      made.onerror = () => reject(new Error(`${data.files.folder}/${name}${data.files.kind} cannot be read: the folder has to lie beside this page.`));
      made.src = address(name);
    });
    images.delete(name);
    images.set(name, image); // the latest last
    if (images.size > MOST) images.delete(images.keys().next().value);
    return image;
  }

  function sheetOf(key, map, side, view) {
    return cell(key)?.[map]?.[side]?.find((sheet) => sheet.views.includes(view));
  }

  function complain(text) {
    const place = document.getElementById("sheets-said");
    place.textContent = text;
    place.hidden = text === "";
  }

  // Draws a picture at its own size; hides the canvas where there is none. Resolves when it is drawn.
  async function draw(canvas, key, map, side, view, text) {
    const sheet = key === undefined ? undefined : sheetOf(key, map, side, view);
    const mark = {};
    wanted.set(canvas, mark);
    canvas.hidden = sheet === undefined;
    canvas.setAttribute("aria-label", text);
    if (sheet === undefined) return;
    try {
      const image = await read(sheet.name);
      if (wanted.get(canvas) !== mark) return;
      const place = sheet.views.indexOf(view);
      const [across, down] = [place % sheet.columns, Math.floor(place / sheet.columns)];
      [canvas.width, canvas.height] = [sheet.width, sheet.height];
      canvas.getContext("2d").drawImage(
        image, across * sheet.width, down * sheet.height, sheet.width, sheet.height, 0, 0, sheet.width, sheet.height,
      );
      complain("");
    } catch (error) {
      if (wanted.get(canvas) !== mark) return;
      canvas.hidden = true;
      complain(error.message);
    }
  }

  const viewsOf = (key, map, side) => (cell(key)?.[map]?.[side] ?? []).flatMap((sheet) => sheet.views);
  return { draw, viewsOf, sizeOf: sheetOf, mapsOf: (key) => Object.keys(cell(key) ?? {}), has: (key) => cell(key) !== null };
})();

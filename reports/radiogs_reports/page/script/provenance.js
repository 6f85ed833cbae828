// A cell's provenance in a dialog, the protocol's conventions in the page. Text nodes only: names never become markup.
(() => {
  const { data, element, nameOf } = shared;
  const dialog = document.getElementById("provenance");
  const runs = new Map(data.runs.map((run) => [run.key, run]));

  function shown(value) {
    if (value === null || typeof value === "object") return "none"; // an object that has nothing in it
    if (typeof value === "number" && !Number.isInteger(value)) return Number(value.toPrecision(6)).toString();
    return typeof value === "number" ? value.toLocaleString("en") : String(value);
  }

  function listed(content) {
    const list = element("dl", undefined, "tree");
    for (const [name, value] of Object.entries(content)) {
      const line = element("div");
      line.append(element("dt", name.replaceAll("_", " ")));
      const place = element("dd");
      place.append(value !== null && typeof value === "object" && Object.keys(value).length ? listed(value) : shown(value));
      line.append(place);
      list.append(line);
    }
    return list;
  }

  function part(title, content) {
    const made = element("section");
    made.append(element("h3", title), listed(content));
    return made;
  }

  function files(run) { // of a finished cell, in the store beside the page
    const made = element("p", "Files beside this page:", "downloads");
    for (const [address, text] of [[`cells/${run.key}.json`, "result as JSON"], [run.arrays, "maps and pictures"]]) {
      const link = element("a", text);
      link.href = address;
      link.download = "";
      made.append(" ", link);
    }
    return made;
  }

  function open(run) {
    shared.say(document.getElementById("provenance-head"), nameOf(run));
    const body = document.getElementById("provenance-body");
    body.replaceChildren(part("Result", { key: run.key, state: run.state, surfels: run.surfels, view: run.view, light: run.light }));
    if (run.arrays) body.append(files(run));
    if (document.getElementById(`sheets-${run.key}`)) {
      const button = element("button", "Show its images");
      button.type = "button";
      button.addEventListener("click", () => {
        dialog.close();
        document.dispatchEvent(new CustomEvent("showcell", { detail: run.key }));
      });
      body.append(button);
    }
    const parts = { "What the key is made of": run.made_from, Metrics: run.metrics, Seconds: run.seconds, Work: run.work, "Last losses": run.losses, Effects: run.effects ?? {} };
    for (const [title, content] of Object.entries(parts)) {
      if (Object.keys(content).length) body.append(part(title, content));
    }
    for (const [stage, sessions] of Object.entries(run.sessions)) {
      sessions.forEach((session, place) => body.append(part(`Session ${place + 1} of ${stage}`, session)));
    }
    dialog.showModal();
    body.scrollTop = 0;
  }

  for (const button of document.querySelectorAll("button.open")) {
    button.addEventListener("click", () => open(runs.get(button.dataset.key)));
  }
  document.getElementById("conventions").append(listed(data.conventions));
})();

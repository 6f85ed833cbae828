// On paper nothing unfolds and ink is dark: what is folded is printed open, in light colours, and both are put back.
(() => {
  const root = document.documentElement;
  const folded = [];
  let theme;
  addEventListener("beforeprint", () => {
    for (const details of document.querySelectorAll("details:not([open])")) {
      details.open = true;
      folded.push(details);
    }
    theme = root.dataset.theme;
    root.dataset.theme = "light";
    document.dispatchEvent(new Event("themechange")); // plots are drawn in the colours of the theme
  });
  addEventListener("afterprint", () => {
    for (const details of folded.splice(0)) details.open = false;
    root.dataset.theme = theme;
    document.dispatchEvent(new Event("themechange"));
  });
})();

// Light or dark, as the system says or as chosen; the choice is kept where the browser lets a file store it.
(() => {
  const names = { system: "as the system", light: "light", dark: "dark" };
  const order = Object.keys(names);
  const button = document.getElementById("theme");

  function kept(theme) { // what is stored, or a theme that is stored now
    try {
      if (theme) localStorage.setItem("radiogs-bench-theme", theme);
      return localStorage.getItem("radiogs-bench-theme");
    } catch {
      return null; // storage is forbidden for this file: the choice lasts as long as the page
    }
  }

  function apply(theme) {
    document.documentElement.dataset.theme = theme;
    button.textContent = `Colours: ${names[theme]}`;
    document.dispatchEvent(new Event("themechange"));
  }

  let theme = order.includes(kept()) ? kept() : "system";
  button.addEventListener("click", () => {
    theme = order[(order.indexOf(theme) + 1) % order.length];
    kept(theme);
    apply(theme);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => apply(theme));
  apply(theme);
})();

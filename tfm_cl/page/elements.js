// What every page uses: elements, and the reader's choice of light or dark.

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

/** Make an element; text never becomes markup. */
function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.includes("-") || name === "role") element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

/** "light" or "dark": that of the notebook around the page if there is one, else the system's. */
function readersTheme() {
  const { jpThemeLight, vscodeThemeKind } = document.body.dataset;
  const dark = jpThemeLight !== undefined ? jpThemeLight === "false"
    : vscodeThemeKind !== undefined ? !vscodeThemeKind.includes("light")
    : matchMedia("(prefers-color-scheme: dark)").matches;
  return dark ? "dark" : "light";
}

/** Give an element of the class `tfm` the reader's theme, and let a button change it; `changed` is called then. */
function followTheme(root, button, changed = () => {}) {
  const set = (name) => {
    const other = name === "dark" ? "light" : "dark";
    root.dataset.theme = name;
    button.textContent = other === "dark" ? "Dark" : "Light";
    button.setAttribute("aria-label", `Use ${other} colours`);
  };
  button.addEventListener("click", () => {
    set(root.dataset.theme === "dark" ? "light" : "dark");
    changed();
  });
  set(readersTheme());
}

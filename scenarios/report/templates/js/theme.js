// Light or dark: as the system has it until somebody decides otherwise.
const darkSystem = matchMedia("(prefers-color-scheme: dark)");
const listeners = [];

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const onTheme = (listener) => listeners.push(listener);

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : darkSystem.matches;
}

function themeSwitch(button) {
  const tell = () => {
    button.textContent = isDark() ? "Light" : "Dark";
    button.setAttribute("aria-label", isDark() ? "Switch to light colours" : "Switch to dark colours");
    listeners.forEach((listener) => listener());
  };
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    tell();
  });
  darkSystem.addEventListener("change", tell);
  tell();
}

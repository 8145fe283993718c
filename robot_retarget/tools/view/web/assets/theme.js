// Colours of the page's theme, light or dark as the browser is set.

const dark = matchMedia("(prefers-color-scheme: dark)");

/** A colour of style.css by its name. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** Call now, and whenever the theme changes. */
export function themed(call) {
  dark.addEventListener("change", call);
  call();
}

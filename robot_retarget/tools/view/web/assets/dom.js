// Elements of a page.

/** An element with attributes and children. */
export function made(kind, attributes = {}, ...children) {
  const element = Object.assign(document.createElement(kind), attributes);
  element.append(...children);
  return element;
}

/** A button that does something. */
export function button(text, act, attributes = {}) {
  const element = made("button", { type: "button", textContent: text, ...attributes });
  element.addEventListener("click", act);
  return element;
}

/** A choice among values; texts are by value, or the values themselves. */
export function select(label, values, chosen, act, texts = {}) {
  const options = values.map((value) => made("option", { value, textContent: texts[value] ?? value, selected: value === chosen }));
  const element = made("select", { ariaLabel: label }, ...options);
  element.addEventListener("change", () => act(element.value));
  return element;
}

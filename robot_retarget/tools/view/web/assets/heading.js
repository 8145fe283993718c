// What is shown: the title of each take, and its verdict. A verdict on an earlier motion says so.

function made(kind, attributes, ...children) {
  const element = Object.assign(document.createElement(kind), attributes);
  element.append(...children);
  return element;
}

function verdictOf({ badge, reasons, stale }) {
  const said = stale ? "judged before the touch-up" : reasons[0] ?? "";
  return [made("i", { className: stale ? "stale" : badge.level, textContent: badge.text }), made("span", { textContent: said })];
}

export class Heading {
  constructor() {
    this.lines = document.getElementById("heading");
  }

  update(takes) {
    this.lines.replaceChildren(...takes.map(({ title, report }) => made("div", {}, made("b", { textContent: title }), ...(report ? verdictOf(report) : []))));
  }
}

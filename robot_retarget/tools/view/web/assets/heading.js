// What is shown: the title of each take, and its verdict. A verdict on an earlier motion says so.

import { made } from "#dom";

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

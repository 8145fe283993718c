// What cannot be read on a page: rows too high, text outside its card or cut, letters too small, contrast too weak.
const [ROW, CONTRAST, SMALLEST] = arguments, faults = new Set()
const said = (what, text) => faults.add(`${what}: ${text.trim().slice(0, 50)}`)
const parts = (css) => (css.match(/[-\d.e]+/g) ?? []).map(Number).map((v, k) => k < 3 && css.startsWith("color") ? 255 * v : v)
const over = (top, ground) => { const a = top[3] ?? 1; return [0, 1, 2].map(k => a * top[k] + (1 - a) * ground[k]) }
const line = ([r, g, b]) => [r, g, b].map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4).reduce((s, v, k) => s + v * [.2126, .7152, .0722][k], 0)
const contrast = (a, b) => { const [x, y] = [line(a), line(b)].sort((p, q) => q - p); return (x + .05) / (y + .05) }
function groundOf(element) {
  const layers = []
  for (let e = element; e; e = e.parentElement) layers.push(parts(getComputedStyle(e).backgroundColor))
  const white = matchMedia("(prefers-color-scheme: dark)").matches ? [18, 18, 18] : [255, 255, 255]
  return layers.reverse().reduce((ground, top) => top.length && (top[3] ?? 1) > 0 ? over(top, ground) : ground, white)
}
function opacityOf(element) {
  let all = 1
  for (let e = element; e; e = e.parentElement) all *= Number(getComputedStyle(e).opacity)
  return all
}
for (const row of document.querySelectorAll("tr, li, p, dd, dt, .row, summary"))
  if (row.checkVisibility() && row.getBoundingClientRect().height > ROW) said(`a row of ${Math.round(row.getBoundingClientRect().height)} px`, row.textContent)
const folded = [...document.querySelectorAll("details:not([open])")]
folded.forEach((details) => (details.open = true))
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), range = document.createRange()
for (let node; (node = walker.nextNode()); ) {
  const element = node.parentElement, text = node.textContent
  if (!text.trim() || element.closest("script, style, option") || !element.checkVisibility({ visibilityProperty: true, opacityProperty: true })) continue
  range.selectNodeContents(node)
  const style = getComputedStyle(element), drawn = element.closest("svg")
  for (const rect of range.getClientRects()) {
    const clips = []
    let reached = false // by scrolling
    for (let e = element; e; e = e.parentElement) {
      const { overflowX, overflowY, display } = getComputedStyle(e), box = e.getBoundingClientRect()
      const card = e.matches("section, header, figure, footer, details, aside, #drop, #live, #heading, #labels div, #touch, #help, .cards > div, button, td, th"), scrolls = e.matches(".scrolls")
      if (scrolls) { clips.push(["scroll", box]); break }
      reached ||= /auto|scroll/.test(overflowY) && e !== document.body
      if (display !== "inline" && (card || overflowX !== "visible" || e === document.body)) clips.push([card ? "outside its card" : "cut", box])
    }
    for (const [why, box] of clips) {
      if (why === "scroll") continue
      if (rect.left < box.left - 1.5 || rect.right > box.right + 1.5) said(`${why} by ${Math.round(Math.max(box.left - rect.left, rect.right - box.right))} px`, text)
      if (why === "cut" && !reached && (rect.top < box.top - 3 || rect.bottom > box.bottom + 3)) said("cut below", text)
    }
    if (!clips.some(([why]) => why === "scroll") && (rect.left < -1 || rect.right > innerWidth + 1)) said("outside the window", text)
  }
  const ends = ["hidden", "clip"].includes(style.overflowX) && element.scrollWidth > element.clientWidth + 1
  if (ends) said("cut", text)
  if (drawn) {
    const { a, b } = element.getScreenCTM(), size = Math.hypot(a, b) * parseFloat(style.fontSize)
    if (size < SMALLEST) said(`letters of ${size.toFixed(1)} px`, text)
  }
  if (element.closest(":disabled")) continue
  const ground = groundOf(element), ink = parts(drawn ? style.fill : style.color)
  const seen = over([...ink.slice(0, 3), (ink[3] ?? 1) * opacityOf(element)], ground)
  if (contrast(seen, ground) < CONTRAST) said(`contrast ${contrast(seen, ground).toFixed(2)}`, text)
}
for (const scroller of document.querySelectorAll(".scrolls")) {
  scroller.scrollLeft = 1e6
  const box = scroller.getBoundingClientRect()
  for (const row of scroller.querySelectorAll("tr")) {
    const [first] = row.cells, alone = row.cells.length === 1
    if (!first.checkVisibility()) continue
    range.selectNodeContents(alone ? first.firstElementChild : first)
    const name = range.getBoundingClientRect()
    if (name.left < box.left - 1 || name.right > box.left + (alone ? 1 : .6) * box.width + 1) said("scrolls without its name", row.textContent)
  }
  scroller.scrollLeft = 0
}
if (document.documentElement.scrollWidth > innerWidth) said("wider than the window", String(document.documentElement.scrollWidth))
folded.forEach((details) => (details.open = false))
return [...faults].join('\n')

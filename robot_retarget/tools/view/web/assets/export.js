// The scene as a picture (PNG) and as a film (WebM), with its titles and labels, made by the browser.

const RATE = 30; // pictures a second of a film
const BITS = 8e6; // of a film, a second
const FILMS = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
const LAST = 400; // the last picture stays so long [ms], and again until the encoder has written
const FONT = "system-ui, sans-serif";

function saved(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export class Export {
  /** @param scene the element that holds the canvas, the titles and the labels */
  constructor({ scene, stage, player }) {
    Object.assign(this, { scene, stage, player, title: "", sheet: document.createElement("canvas") });
    this.kind = globalThis.MediaRecorder && FILMS.find((kind) => MediaRecorder.isTypeSupported(kind));
    stage.after.push(() => this.recorder && this.#compose());
  }

  /** Name the files after a title. */
  named(title) {
    this.title = title.replace(/[^\p{L}\p{N}.-]+/gu, "_");
  }

  /** Put the scene and what is written over it on a sheet of its own. */
  #compose() {
    const { scene, sheet } = this, pen = sheet.getContext("2d"), scale = sheet.width / scene.clientWidth;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.stage.renderer.domElement, 0, 0, sheet.width, sheet.height);
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    const corner = scene.getBoundingClientRect();
    for (const element of scene.querySelectorAll("#labels div:not([hidden])")) if (element.checkVisibility()) this.#write(pen, element, corner);
  }

  #write(pen, element, corner) {
    const { left, top, width, height } = element.getBoundingClientRect(), style = getComputedStyle(element);
    const inset = parseFloat(style.paddingLeft) + parseFloat(style.borderLeftWidth);
    const text = style.textTransform === "uppercase" ? element.textContent.toUpperCase() : element.textContent;
    const [x, y] = [left - corner.left, top - corner.top];
    pen.fillStyle = style.backgroundColor;
    pen.fillRect(x, y, width, height);
    pen.fillStyle = style.borderLeftColor;
    pen.fillRect(x, y, parseFloat(style.borderLeftWidth), height);
    const under = parseFloat(style.borderBottomWidth);
    pen.fillRect(x, y + height - under, width, under);
    pen.fillStyle = style.color;
    pen.font = `${style.fontWeight} ${style.fontSize} ${FONT}`;
    pen.textBaseline = "middle";
    pen.fillText(text, x + inset, y + (height - under) / 2);
  }

  /** A sheet of the size of the scene. */
  async #begin() {
    const { sheet, scene, stage } = this;
    await stage.drawn();
    [sheet.width, sheet.height] = [scene.clientWidth, scene.clientHeight].map((size) => 2 * Math.round((size * stage.finest) / 2));
    this.#compose();
  }

  /** The present view as a PNG. */
  async picture() {
    await this.#begin();
    return new Promise((done) => this.sheet.toBlob(done, "image/png"));
  }

  /** The whole motion from the present view, at the player's speed, as a film. */
  async film() {
    const { player } = this, { loop } = player;
    player.pause();
    player.seek(0);
    player.loop = false;
    await this.#begin();
    const pieces = [], recorder = (this.recorder = new MediaRecorder(this.sheet.captureStream(RATE), { mimeType: this.kind, videoBitsPerSecond: BITS }));
    recorder.addEventListener("dataavailable", ({ data }) => data.size && pieces.push(data));
    const ended = new Promise((done) => recorder.addEventListener("stop", done));
    recorder.start(LAST);
    this.#compose();
    player.play();
    await player.paused();
    await this.stage.drawn();
    do {
      this.#compose();
      await new Promise((done) => setTimeout(done, LAST));
    } while (!pieces.length);
    recorder.stop();
    await ended;
    this.recorder = null;
    player.setLoop(loop);
    return new Blob(pieces, { type: this.kind });
  }

  async savePicture() {
    saved(await this.picture(), `${this.title}_${this.player.time.toFixed(2)}s.png`);
  }

  async saveFilm() {
    if (this.recorder) return this.player.pause();
    const film = await this.film();
    saved(film, `${this.title}.${film.type.includes("mp4") ? "mp4" : "webm"}`);
  }
}

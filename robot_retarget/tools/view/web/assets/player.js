// The clock: a time that runs, stands or is set, and the keys for it.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

export class Player {
  constructor() {
    Object.assign(this, { duration: 0, fps: 1, time: 0, speed: 1, loop: true, playing: false, listeners: [], onpace: () => {} });
  }

  /** The clock of other takes; the time stays where they have it. */
  reset(duration, fps) {
    Object.assign(this, { duration, fps });
    if (!duration) this.playing = false;
    this.seek(this.time);
  }

  onchange(listener) {
    this.listeners.push(listener);
  }

  #tell() {
    this.listeners.forEach((listener) => listener(this));
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.#tell();
  }

  step(frames) {
    this.pause();
    this.seek((Math.round(this.time * this.fps) + frames) / this.fps);
  }

  faster(steps) {
    const place = SPEEDS.indexOf(this.speed);
    this.setSpeed(SPEEDS[Math.min(Math.max(place + steps, 0), SPEEDS.length - 1)]);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.#tell();
  }

  setLoop(loop) {
    this.loop = loop;
    this.#tell();
  }

  toggleLoop() {
    this.setLoop(!this.loop);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  pause() {
    this.playing = false;
    this.onpace();
    this.#tell();
    this.halted?.();
  }

  /** Resolves when it is paused, by anyone or at the end. */
  paused() {
    return new Promise((done) => (this.halted = done));
  }

  play() {
    if (this.playing || !this.duration) return;
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    let before = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      const next = this.time + (this.speed * (now - before)) / 1000;
      this.onpace(now - before);
      before = now;
      if (next > this.duration && !this.loop) {
        this.pause();
        return this.seek(this.duration);
      }
      this.seek(next > this.duration ? next % this.duration : next);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
    this.#tell();
  }
}

export { SPEEDS };

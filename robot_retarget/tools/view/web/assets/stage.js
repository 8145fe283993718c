// The room: light, floor, camera. Draws only when something has changed.

import {
  CanvasTexture, Color, DirectionalLight, Fog, Group, HemisphereLight, LinearMipmapNearestFilter, Mesh, MeshBasicMaterial, NeutralToneMapping, OrbitControls,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, RepeatWrapping, SRGBColorSpace, Scene, ShadowMaterial, Vector3, WebGLRenderer,
} from "#vendor";
import { colour, themed } from "#theme";

const SHADOWS = 2048; // width of the shadow map [pixels]
const SHARPEST = 2; // no more pixels of the screen than this per CSS pixel
const ROOM = 60; // side of the floor, in heights of a robot
const SLOW = 40; // pictures that take longer [ms] are drawn coarser,
const COARSEST = 0.5; // down to this many pixels per CSS pixel

/** Paint a chequered texture in the colours of the theme. */
function tile({ image }) {
  const pen = image.getContext("2d"), colours = [colour("tile"), colour("other-tile")];
  for (const [x, y] of [[0, 0], [0, 1], [1, 0], [1, 1]]) {
    pen.fillStyle = colours[(x + y) % 2];
    pen.fillRect(64 * x, 64 * y, 64, 64);
  }
}

/** A chequered texture, so many periods to a side. */
function tiling(periods) {
  const canvas = Object.assign(document.createElement("canvas"), { width: 128, height: 128 });
  const texture = new CanvasTexture(canvas);
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.repeat.set(periods, periods);
  texture.colorSpace = SRGBColorSpace;
  texture.minFilter = LinearMipmapNearestFilter;
  return texture;
}

export class Stage {
  constructor(holder, canvas) {
    this.holder = holder;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.0;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene = new Scene();
    this.scene.background = new Color();
    this.scene.fog = new Fog(0);
    this.camera = new PerspectiveCamera(30, 1);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.52 * Math.PI;
    this.controls.addEventListener("change", () => this.draw());
    this.following = true;
    this.target = new Vector3();
    this.size(1, 0);
    new ResizeObserver(() => this.#fit()).observe(holder);
    this.after = []; // called with the stage after each picture
    this.pictures = 0;
    this.waiting = []; // called once after the next picture
    themed(() => this.#paint());
  }

  /** Make room. @param height of the tallest robot [m]  @param span of all that is shown side by side [m] */
  size(height, span) {
    if (this.height === height && this.span === span) return;
    Object.assign(this, { height, span });
    Object.assign(this.scene.fog, { near: 5 * height + 2 * span, far: 14 * height + 4 * span });
    Object.assign(this.camera, { near: height / 50, far: 80 * height + 10 * span });
    this.camera.updateProjectionMatrix();
    this.room?.removeFromParent();
    this.room = new Group();
    this.scene.add(this.room);
    this.#light(span);
    this.#floor();
    if (this.after) this.#paint();
  }

  /** Sky and floor in the colours of the theme. */
  #paint() {
    for (const sky of [this.scene.background, this.scene.fog.color]) sky.set(colour("sky"));
    const { map } = this.floor.plane.material;
    tile(map);
    map.needsUpdate = true;
    this.draw();
  }

  #light(span) {
    this.room.add(new HemisphereLight(0xffffff, 0xaab4c0, 1.9));
    const sun = (this.sun = new DirectionalLight(0xfff6ea, 2.4));
    sun.castShadow = true;
    sun.shadow.mapSize.set(SHADOWS, SHADOWS);
    const half = 0.9 * this.height + span / 2;
    Object.assign(sun.shadow.camera, { left: -half, right: half, top: half, bottom: -half, near: 0.1, far: 12 * this.height + span });
    sun.shadow.normalBias = this.height / 400;
    sun.shadow.radius = 3;
    const fill = new DirectionalLight(0xdfeaff, 0.7);
    fill.position.set(-2, 3, 2);
    this.room.add(sun, sun.target, fill);
  }

  /** Tiles without light of their own, and a smaller sheet over them that takes the shadows: cheap to fill. */
  #floor() {
    const width = this.height > 0.8 ? 0.5 : 0.2, side = ROOM * this.height, tiles = tiling(side / (2 * width));
    const plane = new Mesh(new PlaneGeometry(side, side), new MeshBasicMaterial({ map: tiles, toneMapped: false }));
    const sheet = new Mesh(new PlaneGeometry(1, 1), new ShadowMaterial({ opacity: 0.3 }));
    sheet.scale.setScalar(2 * this.sun.shadow.camera.right);
    sheet.receiveShadow = true;
    plane.renderOrder = -2;
    sheet.renderOrder = -1;
    this.floor = { plane, sheet, period: 2 * width };
    this.room.add(plane, sheet);
  }

  /** Set the camera: where it looks, from what azimuth [degrees] and how far [m]. */
  look(target, azimuth, distance) {
    const angle = (azimuth * Math.PI) / 180, up = 0.2;
    this.target.copy(target);
    this.controls.target.copy(target);
    this.camera.position.set(-Math.cos(angle) * distance, -Math.sin(angle) * distance, up * distance).add(target);
    this.controls.update();
    this.distance = distance;
    this.draw();
  }

  /** Go along with what is looked at, nearer or farther as the distance for it changes; the shadow stays with it, so that it stays sharp. */
  follow(target, floor, distance) {
    const step = target.clone().sub(this.target);
    this.target.copy(target);
    if (this.following) {
      this.camera.position.add(step);
      this.controls.target.add(step);
      const { position } = this.camera, seen = this.controls.target;
      position.sub(seen).multiplyScalar(distance / (this.distance ?? distance)).add(seen);
      this.controls.update();
    }
    this.distance = distance;
    const texel = this.sun.shadow.camera.right * 2 / SHADOWS; // whole texels, or edges crawl
    const [x, y] = [target.x, target.y].map((v) => Math.round(v / texel) * texel);
    this.sun.target.position.set(x, y, floor);
    this.sun.position.set(x + 1.6 * this.height, y + 2.2 * this.height, floor + 5 * this.height);
    const { plane, sheet, period } = this.floor;
    plane.position.set(Math.round(x / period) * period, Math.round(y / period) * period, floor);
    sheet.position.set(x, y, floor + this.height / 800);
    this.draw();
  }

  #fit() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    this.finest = Math.min(window.devicePixelRatio, SHARPEST);
    this.renderer.setPixelRatio(this.finest);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** While pictures follow one another: coarser where they come too slowly. `interval` [ms]; none, and all pixels are back. */
  keepPace(interval) {
    const now = this.renderer.getPixelRatio();
    if (interval === undefined) {
      if (now < this.finest) this.renderer.setPixelRatio(this.finest);
      this.renderer.shadowMap.autoUpdate = true;
      this.mean = SLOW / 2;
      return this.draw();
    }
    this.mean = 0.8 * (this.mean ?? SLOW / 2) + 0.2 * Math.min(interval, 4 * SLOW);
    if (this.mean < SLOW || now <= COARSEST) return;
    this.renderer.setPixelRatio(Math.max(0.75 * now, COARSEST));
    this.renderer.shadowMap.autoUpdate = false; // every other picture has shadows of its own
    this.mean = SLOW / 2;
  }

  /** Resolves when the present state has been drawn. */
  drawn() {
    this.draw();
    return new Promise((done) => this.waiting.push(done));
  }

  /** Ask for a picture; any number of requests before the next one make one. */
  draw() {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame(() => {
      this.requested = false;
      this.renderer.shadowMap.needsUpdate = this.pictures % 2 === 0;
      this.renderer.render(this.scene, this.camera);
      this.pictures += 1;
      this.after.forEach((call) => call(this));
      this.waiting.splice(0).forEach((done) => done());
    });
  }
}

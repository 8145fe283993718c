// Puts the page together.

import { Raycaster, Vector2, Vector3 } from "#vendor";
import { Cast, castsOf, rightOf } from "#cast";
import { Charts, hue } from "#charts";
import { embedded } from "#data";
import { Export } from "#export";
import { Heading } from "#heading";
import { Keyframes } from "#keyframes";
import { Panel } from "#panel";
import { Player } from "#player";
import { Stage } from "#stage";
import { Timeline } from "#timeline";
import { Touch } from "#touch";

const ROOMY = 1.08; // what is shown is so much smaller than the picture
const LABEL = 19; // height of a label [pixels]
const EMPTY = new Vector3(0, 0, 0.5); // what is looked at while nothing is there
const MOMENTS = 12; // of a clip, at which the camera's distance is measured
const scene = document.getElementById("scene"), canvas = document.getElementById("canvas");
const takes = [], casts = [], stage = new Stage(scene, canvas), player = new Player();
const labels = document.getElementById("labels"), place = new Vector3();
stage.after.push(() => {
  const { clientWidth, clientHeight } = scene, several = casts.length > 1;
  const said = casts.flatMap((cast, k) => [...cast.labels(), ...(several ? [{ ...cast.nameplate(), color: hue(k) }] : [])]);
  while (labels.children.length < said.length) labels.append(document.createElement("div"));
  const placed = said.map((label) => {
    place.copy(label.at).project(stage.camera);
    return { ...label, x: ((place.x + 1) / 2) * clientWidth, y: ((1 - place.y) / 2) * clientHeight };
  }).sort((a, b) => a.y - b.y);
  apart(placed.filter((label) => label.kind !== "name"), clientHeight);
  [...labels.children].forEach((element, k) => {
    const label = placed[k];
    element.hidden = !label;
    if (!label) return;
    element.className = label.kind;
    element.textContent = label.text;
    element.style.borderBottomColor = label.color ?? "";
    const over = label.kind === "name"; // its lower edge is where the head is
    const [x, y] = over ? [label.x - element.offsetWidth / 2, label.y - element.offsetHeight] : [label.x + 12, label.y - 9];
    const inside = Math.max(0, Math.min(x, clientWidth - element.offsetWidth));
    element.style.transform = `translate(${inside}px, ${y}px)`;
  });
});

/** Labels one under the other where they would overlap, the last above the lower edge of the picture. */
function apart(said, bottom) {
  said.forEach((label, k) => (label.y = Math.max(label.y, 9, k ? said[k - 1].y + LABEL : 0)));
  said.toReversed().forEach((label, k, all) => (label.y = Math.min(label.y, k ? all[k - 1].y - LABEL : bottom - LABEL / 2 - 1)));
}

const exported = new Export({ scene, stage, player });
const panel = new Panel(player, stage, casts, exported), timeline = new Timeline(player, takes), charts = new Charts(player, takes);
const heading = new Heading();

/** Show takes side by side in place of those before; the camera stays where `still` says that they are the same ones. */
function mount(shown, still = false) {
  const { casts: made, span } = castsOf(shown), where = casts[0]?.parts.human?.where;
  casts.forEach(discard);
  takes.splice(0, Infinity, ...shown);
  casts.splice(0, Infinity, ...made);
  casts.forEach((cast) => {
    stage.scene.add(cast);
    if (where) cast.parts.human?.stand(where);
  });
  if (takes.length) stage.size(Math.max(...takes.map((take) => take.height)), takes.length > 1 ? span : 0);
  framed.aspect = 0;
  player.reset(Math.max(0, ...takes.map((take) => (take.frames - 1) / take.fps)), Math.max(1, ...takes.map((take) => take.fps)));
  exported.named(takes.map((take) => take.title).join(" "));
  panel.refresh();
  heading.update(takes);
  timeline.draw();
  charts.reset();
  pose();
  if (!still && takes.length) requestAnimationFrame(home);
  if (!takes.length) stage.look(EMPTY, 0, 5);
}

function discard(cast) {
  cast.removeFromParent();
  cast.traverse(({ geometry }) => geometry?.dispose());
}

/** The middle of everything that is looked at. */
function target(time) {
  return casts.reduce((sum, cast) => sum.add(cast.target(time)), new Vector3()).divideScalar(casts.length);
}

/** How far the camera is from the middle for all takes to be in the picture at a time [m]. */
function fitted(time) {
  const right = rightOf(takes[0].azimuth), away = new Vector3(-right.y, right.x, 0);
  const { aspect, fov } = stage.camera, tall = Math.tan((fov * Math.PI) / 360), wide = tall * aspect, middle = target(time);
  return Math.max(...casts.flatMap((cast) => cast.corners(time, right)).map((corner) => {
    const from = corner.sub(middle);
    return ROOMY * (Math.max(Math.abs(from.dot(right)) / wide, Math.abs(from.z) / tall) - from.dot(away));
  }));
}

const framed = { aspect: 0, reach: 0, distance: 0 };

/** The camera's distance at a time [m]: one take keeps the largest of the clip, so that the picture does not breathe. */
function distance(time) {
  if (takes.length > 1) return fitted(time);
  const { camera: { aspect } } = stage, [{ reach }] = takes;
  if (framed.aspect !== aspect || framed.reach !== reach) {
    const moments = Array.from({ length: MOMENTS }, (_, k) => (k / (MOMENTS - 1)) * player.duration);
    Object.assign(framed, { aspect, reach, distance: Math.max(...moments.map(fitted)) });
  }
  return framed.distance;
}

function pose() {
  if (!casts.length) return stage.draw();
  const floor = Math.min(...takes.map((take) => take.floor));
  casts.forEach((cast) => cast.pose(player.time));
  stage.follow(target(player.time), floor, distance(player.time));
}

function home() {
  stage.look(target(player.time), takes[0].azimuth, distance(player.time));
}

player.onchange(pose);
new ResizeObserver(pose).observe(scene);
player.onpace = (interval) => stage.keepPace(interval);
panel.onreset = home;
mount((await embedded()).takes);
if (location.hash === "#play") player.play();

// What is under the pointer: the body, and the joint that moves it; a click shows that joint's curves.
const ray = new Raycaster(), pointer = new Vector2(), said = document.getElementById("said");

function under(event) {
  const box = canvas.getBoundingClientRect();
  pointer.set(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
  ray.setFromCamera(pointer, stage.camera);
  for (const [k, cast] of casts.entries()) {
    const [hit] = cast.parts.robot.visible ? ray.intersectObject(cast.parts.robot) : [];
    if (hit) return { take: k, ...cast.take.bodies[hit.object.userData.body] };
  }
  return null;
}

let pressed = null;
canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
canvas.addEventListener("pointerup", (event) => {
  const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
  const body = still && under(event);
  if (body && !touch?.on) charts.choose(body.take, body.joint);
});
canvas.addEventListener("pointermove", (event) => {
  if (event.buttons || player.playing) return (said.textContent = "");
  const edge = edgeUnder(event), body = edge ? null : under(event);
  said.textContent = edge ?? (body ? saying(body) : "");
});

function edgeUnder(event) {
  const box = canvas.getBoundingClientRect();
  const shown = casts.map((cast) => cast.parts.edges).filter((edges) => edges?.visible);
  return shown.map((edges) => edges.under(event.clientX - box.left, event.clientY - box.top, stage.camera, box)).find(Boolean) ?? null;
}

function saying({ take, name, joint }) {
  const { joints } = takes[take];
  if (joint < 0) return name;
  const frame = Math.min(Math.round(player.time * takes[take].fps), takes[take].frames - 1);
  const degrees = (joints.angles.values[frame * joints.angles.width + joint] * 180) / Math.PI;
  return `${name} · ${joints.names[joint]} ${degrees.toFixed(1)}° of ${joints.lower[joint].toFixed(0)} … ${joints.upper[joint].toFixed(0)}°`;
}

/** Another take in place of the k-th. */
function replaced(k, take) {
  const old = casts[k], cast = new Cast(take, old.position);
  discard(old);
  cast.parts.human?.stand(old.parts.human?.where ?? "beside");
  casts[k] = cast;
  takes[k] = take;
  stage.scene.add(cast);
  panel.refresh();
  heading.update(takes);
  charts.draw();
  timeline.draw();
  pose();
}

const touch = document.body.matches(".touch, .studio") ? new Touch({ stage, player, panel, casts, replaced }) : null;

const keyframes = document.body.matches(".keyframes") ? new Keyframes({ stage, player, panel, casts, charts, mount }) : null;

const studio = document.body.matches(".studio") ? new (await import("#studio")).Studio({ mount, player, panel, touch, takes, casts, charts }) : null;

window.viewer = { stage, studio, player, panel, casts, charts, takes, touch, keyframes, exported, heading };
document.documentElement.dataset.ready = "yes";

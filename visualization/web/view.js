// State, cameras and panel. `scene` is what a console or a test can call.
"use strict";
const AHEAD = 20;  // metres; where the camera behind the car looks
const NARROW = 800;  // pixels; narrower windows open without the panel
const LENS = {orbitAxis: "Z", fovy: 40, near: 0.05, far: 100};
const LETTER_WIDTH = 8, LINE_HEIGHT = 18;  // pixels, of the words above boxes
const state = {
  frame: 0, camera: "behind", split: TRACKERS.length > 1, points: true, labels: Boolean(LABELS),
  errors: Boolean(LABELS), trails: true, names: true, size: 2, trackers: TRACKERS.map(() => true),
  sets: NETWORK ? NETWORK.sets.map((set) => set.visible) : [], arrows: true, exaggeration: 3,
  proposals: true, object: NETWORK && TRACKERS[0].count ? 0 : null, group: false,
};
const view = document.getElementById("view");
let camera, drawn = 0, opened = null;  // opened: milliseconds from the start to the first picture

function element(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

function panes() {
  const shown = TRACKERS.map((_, k) => k).filter((k) => state.trackers[k]);
  return state.split && shown.length > 1 ? shown : [];
}

function cameraOf(name) {
  const width = view.clientWidth / Math.max(1, panes().length), height = view.clientHeight;
  const fit = (metres, pixels) => Math.log2(pixels / metres);
  if (name === "above") {
    const zoom = Math.min(fit(80, width), fit(60, height));
    return {target: [34, 0, 0], rotationX: 90, rotationOrbit: 90, zoom};
  }
  if (name === "world") {
    const places = Array.from({length: SCENE.frames}, (_, t) => poseOf(t).slice(12, 14));
    const range = (i) => [Math.min(...places.map((p) => p[i])), Math.max(...places.map((p) => p[i]))];
    const [[x0, x1], [y0, y1]] = [range(0), range(1)];
    const zoom = fit(Math.max(x1 - x0, y1 - y0) + 90, Math.min(width, height));
    return {target: [(x0 + x1) / 2 + 20, (y0 + y1) / 2, 0], rotationX: 50, rotationOrbit: 90, zoom};
  }
  return {target: [AHEAD, 0, 0], rotationX: 28, rotationOrbit: 90,
    zoom: Math.min(fit(46, width), fit(36, height))};
}

const instance = new deck.Deck({
  parent: view, deviceProps: {webgl: {antialias: false, preserveDrawingBuffer: false}}, getTooltip: ({object}) => describe(object), layers: [], views: [],
  viewState: {}, pickingRadius: 4, onAfterRender: () => { drawn += 1; opened ??= performance.now(); },
  onViewStateChange: ({viewState}) => { camera = viewState; draw(); },
  onClick: ({object}) => { if (NETWORK && object && object.owner === TRACKERS[0].name) choose(object.track); },
  onResize: () => { if (camera) draw(); }, onError: (error) => console.error(error.message),
  layerFilter: ({layer, viewport}) => {
    const of = /^tracker(\d+)-/.exec(layer.id);
    return !of || viewport.id === "all" || viewport.id === `pane${of[1]}`;
  },
});

function draw() {
  const shown = panes(), ids = shown.length ? shown.map((k) => `pane${k}`) : ["all"];
  instance.setProps({
    layers: sceneLayers(state), viewState: Object.fromEntries(ids.map((id) => [id, camera])),
    views: ids.map((id, i) => new deck.OrbitView({
      ...LENS, id, x: `${100 * i / ids.length}%`, width: `${100 / ids.length}%`, controller: true,
    })),
  });
  const names = shown.map((k) => element("span", {textContent: TRACKERS[k].name}));
  document.getElementById("panes").replaceChildren(...names);
  write(shown);
}

// The words of each pane (see trackerWords), where its camera sees their places; a word that would
// cover an earlier one goes above it.
function write(shown) {
  const matrix = matrixOf(state), made = [], taken = [];
  TRACKERS.forEach((_, k) => {
    if (!state.trackers[k]) return;
    const pane = shown.indexOf(k), width = view.clientWidth / Math.max(1, shown.length);
    const height = view.clientHeight, left = Math.max(0, pane) * width;
    const viewport = new deck.OrbitView({...LENS, id: "words"}).makeViewport(
      {width, height, viewState: camera});
    for (const {place: at, text, color} of trackerWords(k, state, matrix)) {
      const [x, y, depth] = viewport.project(at);
      if (depth > 1 || depth < 0 || x < 0 || x > width || y < 0 || y > height) continue;
      const place = {x: left + x, y, half: LETTER_WIDTH * (text.length + 1) / 2};
      const covers = (other) => Math.abs(other.x - place.x) < other.half + place.half &&
        Math.abs(other.y - place.y) < LINE_HEIGHT;
      while (taken.some(covers)) place.y -= LINE_HEIGHT;
      taken.push(place);
      const word = element("b", {textContent: text});
      word.style.cssText = `left:${place.x}px;top:${place.y}px;color:rgb(${color})`;
      made.push(word);
    }
  });
  document.getElementById("words").replaceChildren(...made);
}

function look(name) {
  state.camera = name;
  camera = cameraOf(name);
  for (const button of document.querySelectorAll("#cameras button[data-camera]")) {
    button.classList.toggle("on", button.dataset.camera === name);
  }
  draw();
}

function show(t) {
  state.frame = Math.max(0, Math.min(SCENE.frames - 1, t));
  draw();
  showTime();
}

function choose(id) {
  state.object = id;
  const select = document.getElementById("object");
  if (select) select.value = id;
  draw();
}

function toggle(parent, text, note, checked, change) {
  const input = element("input", {type: "checkbox", checked});
  input.addEventListener("change", () => { change(input.checked); draw(); });
  parent.append(element("label", {}, input, text, element("small", {textContent: note})));
}

function number(parent, text, value, [min, max, step], change) {
  const input = element("input", {type: "range", min, max, step, value, ariaLabel: text});
  const shown = element("small", {textContent: value});
  input.addEventListener("input", () => { shown.textContent = input.value; change(+input.value); draw(); });
  parent.append(element("label", {}, text, shown), input);
}

// Hides the panel or shows it again; the view takes the room.
function fold(hidden) {
  const button = document.getElementById("fold");
  button.ariaExpanded = String(!hidden);
  button.textContent = hidden ? "›" : "‹";
  button.title = hidden ? "show the panel" : "hide the panel";
}

function buildPanel() {
  document.getElementById("fold").addEventListener("click", (event) =>
    fold(event.currentTarget.ariaExpanded === "true"));
  fold(window.innerWidth < NARROW);
  const panel = document.getElementById("layers"), set = (name) => (on) => { state[name] = on; };
  toggle(panel, "Points", SCENE.points.shading, state.points, set("points"));
  number(panel, "Point size", state.size, [1, 6, 0.5], set("size"));
  if (LABELS) toggle(panel, "Labels", "green", state.labels, set("labels"));
  TRACKERS.forEach((tracker, k) => {
    const text = (TRACKERS.length > 1 ? `${LETTERS[k]}: ` : "") + tracker.name;
    toggle(panel, text, `${tracker.tracks.length} ids`, true, (on) => { state.trackers[k] = on; });
  });
  if (TRACKERS.length) toggle(panel, "Ids", "", state.names, set("names"));
  if (LABELS && TRACKERS.length) toggle(panel, "Errors", "misses, ...", state.errors, set("errors"));
  if (NETWORK) buildNetworkPanel(panel, set);
  else if (TRACKERS.length) toggle(panel, "Trails", "3 s", state.trails, set("trails"));
}

function buildNetworkPanel(panel, set) {
  NETWORK.sets.forEach((points, k) => toggle(panel, points.name, `${points.xyz.length / 3}`,
    points.visible, (on) => { state.sets[k] = on; }));
  toggle(panel, "Displacement", "arrows", state.arrows, set("arrows"));
  number(panel, "Exaggeration", state.exaggeration, [1, 20, 1], set("exaggeration"));
  if (NETWORK.group) toggle(panel, "Association", "one point's group", false, set("group"));
  toggle(panel, "Proposals of", "", state.proposals, set("proposals"));
  const select = element("select", {id: "object", ariaLabel: "object"},
    ...TRACKERS[0].tracks.map((_, id) => element("option", {value: id, textContent: `detection ${id}`})));
  select.addEventListener("change", () => choose(+select.value));
  panel.append(select);
}

function buildCameras() {
  const parent = document.getElementById("cameras");
  const button = (name, text) => {
    const made = element("button", {textContent: text});
    made.dataset.camera = name;
    made.addEventListener("click", () => look(name));
    parent.append(made);
    return made;
  };
  button("behind", "Follow the car");
  button("above", "Above");
  const world = button("world", "World");
  if (!POSES) {
    world.disabled = true;
    world.title = "needs the sensor's poses, which this sequence lacks";
  }
  if (TRACKERS.length > 1) {
    const split = element("button", {textContent: "Side by side", className: "on"});
    split.addEventListener("click", () => {
      state.split = !state.split;
      split.classList.toggle("on", state.split);
      look(state.camera);
    });
    parent.append(split);
  }
}

// deck.gl's layers of one frame.
"use strict";
const GREEN = [70, 214, 110], MISS = [255, 165, 61], ALARM = [255, 90, 95], SWITCH = [197, 139, 255];
const ALARM_ROW = 1, SWITCH_ROW = 2;  // of a tracker's row: 0 matched, -1 not evaluated
const LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ";
const WORDS = {[ALARM_ROW]: "false alarm", [SWITCH_ROW]: "switch"};
const EDGES = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4],
  [0, 4], [1, 5], [2, 6], [3, 7]];
const TRAIL = 30;  // frames
const RINGS = [20, 40, 60, 80];  // metres
const CAR = {box: [0, 0, -0.9, 4, 1.8, 1.5, 0], color: [140, 150, 165]};  // that carries the sensor

function lineLayer(id, data, width, matrix, more) {
  return new deck.LineLayer({
    id, data, getSourcePosition: (d) => d.from, getTargetPosition: (d) => d.to,
    getColor: (d) => d.color, getWidth: width, widthUnits: "pixels", modelMatrix: matrix, ...more,
  });
}

// Twelve edges, and a stroke from the middle of the roof ahead: the heading.
function strokes(rows) {
  return rows.flatMap(({box, color}) => {
    const c = corners(box), [x, y, , l, , h, yaw] = box, z = box[2] + h / 2;
    const tip = [x + Math.cos(yaw) * (l / 2 + 1.2), y + Math.sin(yaw) * (l / 2 + 1.2), z];
    return [...EDGES.map(([a, b]) => ({from: c[a], to: c[b], color})),
      {from: [x, y, z], to: tip, color}];
  });
}

const CAR_STROKES = strokes([CAR]);

function boxLayers(id, rows, width, matrix) {
  const body = new deck.SolidPolygonLayer({
    id: `${id}-body`, data: rows, extruded: true, material: false, pickable: true,
    getPolygon: (d) => corners(d.box).slice(0, 4), getElevation: (d) => d.box[5],
    getFillColor: (d) => [...d.color, 38], modelMatrix: matrix,
    parameters: {depthWriteEnabled: false},
  });
  return [body, lineLayer(`${id}-edges`, strokes(rows), width, matrix)];
}

// Words above boxes are HTML over the picture: sharp at any scale, and cheap to draw.
function words(rows, textOf, matrix) {
  return rows.map((row) => {
    const [x, y, z, , , h] = row.box, {text, color} = textOf(row);
    return {place: moved(matrix, [x, y, z + h / 2 + 0.9]), text, color};
  });
}

function trailLayer(id, tracker, rows, t, matrix) {
  const paths = rows.map((row) => {
    const way = tracker.tracks[row.track].filter((r) => r.frame <= t && r.frame > t - TRAIL);
    return {color: row.color, path: way.map((r) => moved(poseOf(r.frame), r.box))};
  });
  return new deck.PathLayer({
    id, data: paths.filter((d) => d.path.length > 1), getPath: (d) => d.path, billboard: true,
    getColor: (d) => [...d.color, 200], getWidth: 2, widthUnits: "pixels", modelMatrix: matrix,
  });
}

const GROUND = RINGS.flatMap((radius) => Array.from({length: 72}, (_, i) => {
  const at = (k) => [radius * Math.cos(k * Math.PI / 36), radius * Math.sin(k * Math.PI / 36), -1.7];
  return {from: at(i), to: at(i + 1), color: [52, 60, 74]};
}));

function trackerLayers(k, state, matrix, trailMatrix) {
  const tracker = TRACKERS[k], t = state.frame, rows = tracker.byFrame[t], id = `tracker${k}-`;
  const layers = boxLayers(`${id}box`, rows, k ? 1.5 : 2.5, matrix);
  if (state.trails) layers.push(trailLayer(`${id}trail`, tracker, rows, t, trailMatrix));
  if (state.errors && LABELS) {
    const missed = LABELS.byFrame[t].filter((row) => row.errors[k]);
    layers.push(lineLayer(`${id}missed`, strokes(missed.map((r) => ({...r, color: MISS}))), 2, matrix));
  }
  return layers;
}

// The words that a tracker's boxes carry: ids, and errors where they are shown.
function trackerWords(k, state, matrix) {
  const rows = TRACKERS[k].byFrame[state.frame];
  const prefix = TRACKERS.length > 1 && !state.split ? LETTERS[k] : "";
  const named = words(rows, (row) => {
    const error = state.errors ? WORDS[row.errors[0]] : undefined;
    const color = error ? (error === "switch" ? SWITCH : ALARM) : row.color;
    return {text: `${state.names ? prefix + row.id : ""} ${error ?? ""}`.trim(), color};
  }, matrix).filter(({text}) => text);
  if (!state.errors || !LABELS) return named;
  const missed = LABELS.byFrame[state.frame].filter((row) => row.errors[k]);
  return [...named, ...words(missed, () => ({text: `${prefix}${prefix && " "}miss`, color: MISS}), matrix)];
}

function matrixOf(state) {
  return state.camera === "world" ? poseOf(state.frame) : IDENTITY;
}

// All layers; `state` is that of view.js.
function sceneLayers(state) {
  const t = state.frame, matrix = matrixOf(state);
  const trailMatrix = state.camera === "world" ? IDENTITY : inverse(poseOf(t));
  const layers = [lineLayer("rings", GROUND, 1, matrix), lineLayer("car", CAR_STROKES, 1.5, matrix)];
  if (state.points) {
    layers.push(new DotLayer({id: "points", data: pointsOf(t), size: state.size, modelMatrix: matrix}));
  }
  if (state.labels && LABELS) layers.push(...boxLayers("label", LABELS.byFrame[t], 1.5, matrix));
  TRACKERS.forEach((_, k) => {
    if (state.trackers[k]) layers.push(...trackerLayers(k, state, matrix, trailMatrix));
  });
  return [...layers, ...networkLayers(state, matrix)];
}

function describe(row) {
  if (!row || row.id === undefined) return null;
  const number = (value, digits, unit) =>
    Number.isFinite(value) ? value.toFixed(digits) + unit : "unknown";
  const lines = [`${row.owner}: id ${row.id}`, `class ${row.kind}`];
  if (row.owner === "labels") {
    TRACKERS.forEach((tracker, k) => row.errors[k] && lines.push(`missed by ${tracker.name}`));
  } else {
    lines.push(`score ${number(row.score, 3, "")}`);
    if (WORDS[row.errors[0]]) lines.push(WORDS[row.errors[0]]);
  }
  if (SCENE.speed) lines.push(`${SCENE.speed} ${number(row.speed, 1, " m/s")}`);
  return {text: lines.join("\n")};
}

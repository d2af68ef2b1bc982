// The scene's data: typed arrays out of base64, points only when their frame is shown.
"use strict";
const SCENE = JSON.parse(document.getElementById("scene").textContent);
const TYPES = {
  int8: Int8Array, uint8: Uint8Array, int16: Int16Array, int32: Int32Array, float32: Float32Array,
};

function bytesOf(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

function decode(packed) {
  return new TYPES[packed.type](bytesOf(packed.data).buffer);
}

// Rows of boxes as objects, by frame and by track.
function decodeBoxes(packed) {
  const [frame, track, kind, score, speed, box] =
    ["frame", "track", "type", "score", "speed", "box"].map((name) => decode(packed[name]));
  const errors = packed.errors.map(decode);
  const byFrame = Array.from({length: SCENE.frames}, () => []), tracks = packed.ids.map(() => []);
  for (let r = 0; r < frame.length; r++) {
    const row = {
      owner: packed.name, frame: frame[r], track: track[r], id: packed.ids[track[r]],
      kind: packed.types[kind[r]], score: score[r], speed: speed[r],
      box: box.subarray(7 * r, 7 * r + 7), color: packed.colors[track[r]], errors: errors.map((e) => e[r]),
    };
    byFrame[row.frame].push(row);
    tracks[row.track].push(row);
  }
  return {name: packed.name, byFrame, tracks, count: frame.length};
}

function pointsOf(t) {
  const packed = SCENE.points.frames[t], bytes = bytesOf(packed);
  const n = bytes.length / 7, steps = new Int16Array(bytes.buffer, 0, 3 * n);
  const position = new Float32Array(3 * n), color = new Uint8Array(4 * n).fill(255);
  for (let i = 0; i < 3 * n; i++) position[i] = steps[i] * SCENE.points.step;
  for (let i = 0; i < n; i++) color.set(SCENE.points.colors[bytes[6 * n + i]], 4 * i);
  return {length: n, attributes: {
    getPosition: {value: position, size: 3}, getColor: {value: color, size: 4},
  }};
}

// 4x4 matrices are column by column, as deck.gl takes them.
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const POSES = SCENE.poses && decode(SCENE.poses);

function poseOf(t) {
  return POSES ? Array.from(POSES.subarray(16 * t, 16 * t + 16)) : IDENTITY;
}

function inverse(m) {
  const turned = [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0];
  const at = (i) => -(m[4 * i] * m[12] + m[4 * i + 1] * m[13] + m[4 * i + 2] * m[14]);
  return [...turned, at(0), at(1), at(2), 1];
}

function moved(m, [x, y, z]) {
  return [0, 1, 2].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i]);
}

// Corners as kitti.boxes.box_corners has them: the lower face, then the upper one.
function corners(box) {
  const [x, y, z, l, w, h, yaw] = box, c = Math.cos(yaw), s = Math.sin(yaw), out = [];
  for (const up of [-1, 1]) {
    for (const [a, b] of [[1, 1], [-1, 1], [-1, -1], [1, -1]]) {
      const u = a * l / 2, v = b * w / 2;
      out.push([x + c * u - s * v, y + s * u + c * v, z + up * h / 2]);
    }
  }
  return out;
}

const LABELS = SCENE.labels && decodeBoxes(SCENE.labels);
const TRACKERS = SCENE.trackers.map(decodeBoxes);

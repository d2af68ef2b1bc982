// What the networks see in one frame: sets of points, displacement arrows, proposals, a group.
"use strict";
const NETWORK = SCENE.network && {
  sets: SCENE.network.sets.map((set) => ({...set, xyz: decode(set.xyz)})),
  from: decode(SCENE.network.arrows.from), by: decode(SCENE.network.arrows.by),
  proposals: decode(SCENE.network.proposals.box), scores: decode(SCENE.network.proposals.score),
  owners: decode(SCENE.network.proposals.owner), group: SCENE.network.group,
};

function arrows(exaggeration) {
  const {from, by} = NETWORK, out = [];
  for (let i = 0; i < from.length; i += 3) {
    const [x, y, z] = from.subarray(i, i + 3);
    const [u, v, w] = by.subarray(i, i + 3).map((d) => d * exaggeration);
    const length = Math.hypot(u, v), barb = Math.min(0.5, 0.3 * length);
    const tip = [x + u, y + v, z + w], color = [255, 211, 77];
    out.push({from: [x, y, z], to: tip, color});
    if (length < 0.05) continue;
    for (const turn of [2.6, -2.6]) {
      const angle = Math.atan2(v, u) + turn;
      const to = [tip[0] + barb * Math.cos(angle), tip[1] + barb * Math.sin(angle), tip[2]];
      out.push({from: tip, to, color});
    }
  }
  return out;
}

function proposals(owner) {
  const out = [];
  NETWORK.owners.forEach((o, i) => {
    if (o !== owner) return;
    const score = NETWORK.scores[i];
    out.push({
      owner: "proposal", id: i, kind: "", score, speed: NaN, errors: [],
      box: NETWORK.proposals.subarray(7 * i, 7 * i + 7), color: [255, 80 + 150 * score, 160, 110],
    });
  });
  return out;
}

function networkLayers(state, matrix) {
  if (!NETWORK) return [];
  const layers = NETWORK.sets.filter((_, k) => state.sets[k]).map((set) =>
    new DotLayer({
      id: `set-${set.name}`, size: set.size, getColor: [...set.color, 255], modelMatrix: matrix,
      data: {length: set.xyz.length / 3, attributes: {getPosition: {value: set.xyz, size: 3}}},
    }));
  if (state.arrows) layers.push(lineLayer("arrows", arrows(state.exaggeration), 1.5, matrix));
  if (state.proposals && state.object !== null) {
    layers.push(lineLayer("proposals", strokes(proposals(state.object)), 1, matrix));
  }
  if (state.group) {
    const {point, neighbors} = NETWORK.group;
    const lines = neighbors.map((to) => ({from: point, to, color: [120, 200, 255]}));
    layers.push(lineLayer("group", lines, 1, matrix));
  }
  return layers;
}

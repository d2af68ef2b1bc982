// Slider, play button, and the strip that marks each frame's errors.
"use strict";
const KINDS = [["misses", "--miss"], ["false alarms", "--alarm"], ["switches", "--switch"]];
const THUMB = 8;  // pixels; half of the slider's thumb, by which its track is inset
const timeline = document.getElementById("timeline");
const slider = element("input", {type: "range", id: "slider", min: 0, max: SCENE.frames - 1,
  value: 0, ariaLabel: "frame"});
const clock = element("output");
const playButton = element("button", {textContent: "▶ Play", id: "play"});
let playing = null, pace = 1;

// Per tracker and kind of error: the count of each frame.
const ERRORS = TRACKERS.map((tracker, k) => {
  const count = (lists, test) => lists.map((rows) => rows.filter(test).length);
  return [count(LABELS ? LABELS.byFrame : [], (row) => row.errors[k]),
    count(tracker.byFrame, (row) => row.errors[0] === ALARM_ROW),
    count(tracker.byFrame, (row) => row.errors[0] === SWITCH_ROW)];
});

function showTime() {
  slider.value = state.frame;
  const share = state.frame / Math.max(1, SCENE.frames - 1);
  const left = `calc(${THUMB}px + (100% - ${2 * THUMB}px) * ${share})`;
  for (const cursor of document.querySelectorAll(".strip i")) cursor.style.left = left;
  const last = SCENE.first + SCENE.frames - 1, of = SCENE.frames > 1 ? ` of ${SCENE.first}-${last}` : "";
  clock.textContent = `frame ${state.frame + SCENE.first}${of}`;
}

function play(on) {
  if (playing) cancelAnimationFrame(playing);
  playing = null;
  playButton.textContent = on ? "❚❚ Pause" : "▶ Play";
  if (!on) return;
  let due = performance.now();
  const step = (now) => {
    if (now >= due) {
      due = Math.max(due + 1000 * SCENE.period / pace, now - 50);
      show((state.frame + 1) % SCENE.frames);
    }
    playing = requestAnimationFrame(step);
  };
  playing = requestAnimationFrame(step);
}

// The next frame with an error of the chosen kind (-1: any) of a tracker that is shown.
function jump(direction, kind) {
  for (let i = 1; i <= SCENE.frames; i++) {
    const t = (state.frame + direction * i + SCENE.frames * i) % SCENE.frames;
    const found = ERRORS.some((counts, k) => state.trackers[k] &&
      counts.some((c, j) => (kind < 0 || kind === j) && c[t] > 0));
    if (found) return show(t);
  }
}

function strip(k) {
  const canvas = element("canvas", {title: "misses, false alarms, id switches: click to jump"});
  const sums = ERRORS[k].map((c, j) => `${c.reduce((a, b) => a + b, 0)} ${KINDS[j][0]}`).join(", ");
  const name = element("span", {}, element("b", {textContent: TRACKERS[k].name}), `: ${sums}`);
  const last = Math.max(1, SCENE.frames - 1);
  canvas.addEventListener("click", (event) => {
    const share = (event.offsetX - THUMB) / (canvas.clientWidth - 2 * THUMB);
    show(Math.round(share * last));
  });
  const lanes = element("div", {className: "strip"}, canvas, element("i"));
  timeline.append(element("p", {className: "sums"}, name), lanes);
  const style = getComputedStyle(document.documentElement);
  return () => {
    const scale = window.devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight;
    canvas.width = w * scale;
    canvas.height = h * scale;
    const pen = canvas.getContext("2d"), bar = Math.max(1, (w - 2 * THUMB) / SCENE.frames);
    pen.scale(scale, scale);
    const x = (t) => THUMB + (w - 2 * THUMB) * t / last, lane = h / KINDS.length;
    ERRORS[k].forEach((counts, j) => {
      pen.fillStyle = "#232a36";
      pen.fillRect(THUMB, j * lane + 0.5, w - 2 * THUMB, lane - 1);
      pen.fillStyle = style.getPropertyValue(KINDS[j][1]);
      counts.forEach((count, t) => {
        if (!count) return;
        pen.globalAlpha = Math.min(1, 0.45 + 0.2 * count);
        pen.fillRect(x(t) - bar / 2, j * lane + 0.5, bar, lane - 1);
      });
      pen.globalAlpha = 1;
    });
  };
}

function legend() {
  const marks = KINDS.map(([text, color]) => {
    const mark = element("b", {textContent: `■ ${text}`});
    mark.style.color = `var(${color})`;
    return mark;
  });
  return element("span", {className: "legend"}, ...marks);
}

const strips = [];

function buildTimeline() {
  const row = element("div", {className: "row"});
  if (SCENE.frames > 1) {
    const speed = element("select", {ariaLabel: "pace"}, ...[0.5, 1, 2, 4].map((value) =>
      element("option", {value, textContent: `${value}x`, selected: value === 1})));
    speed.addEventListener("change", () => { pace = +speed.value; });
    playButton.addEventListener("click", () => play(!playing));
    slider.addEventListener("input", () => show(+slider.value));
    row.append(playButton, speed);
  }
  row.append(clock);
  timeline.append(row);
  if (SCENE.frames > 1) timeline.append(slider);
  if (!LABELS) {
    const text = "No labels: misses, false alarms and switches are unknown.";
    timeline.append(element("p", {className: "empty", textContent: text}));
  } else if (!NETWORK && TRACKERS.length) {
    const kind = element("select", {ariaLabel: "kind of error"}, ...["any error",
      ...KINDS.map(([text]) => text)].map((text, i) => element("option", {value: i - 1, textContent: text})));
    const button = (textContent, direction) => {
      const made = element("button", {textContent});
      made.addEventListener("click", () => jump(direction, +kind.value));
      return made;
    };
    if (SCENE.frames > 1) row.append(button("‹ previous", -1), kind, button("next ›", 1));
    row.append(legend());
    TRACKERS.forEach((_, k) => strips.push(strip(k)));
  }
  const drawStrips = () => strips.forEach((draw) => draw());
  window.addEventListener("resize", drawStrips);
  drawStrips();
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("select, input, button, summary")) return;
    if (event.key === " ") play(!playing);
    else if (event.key === "ArrowRight") show(state.frame + 1);
    else if (event.key === "ArrowLeft") show(state.frame - 1);
    else return;
    event.preventDefault();
  });
}

buildPanel();
buildCameras();
buildTimeline();
look("behind");
showTime();
window.scene = {state, show, look, play, jump, choose, instance, draws: () => drawn, opened: () => opened};

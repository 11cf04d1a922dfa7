"use strict";
// The picture, its points and the mask on the canvas.
// A place is [column, row] of a pixel of the picture, from the upper left; a point is {place, positive}.

const $ = (id) => document.getElementById(id);
const canvas = $("canvas"), pen = canvas.getContext("2d");
const POINT_RADIUS = 9; // [CSS pixels]

let picture = null; // the drawn image
let view = { scale: 1, left: 0, top: 0 }; // screen = left + column * stretch[0] * scale
let stretch = [1, 1]; // of pixels that are not square
let mask = null; // {outline, shade, ...} as the last answer gave it
let maskShown = true;

// --- The view -------------------------------------------------------------------------------------------------------

const toScreen = ([column, row]) => [
  view.left + column * stretch[0] * view.scale, view.top + row * stretch[1] * view.scale,
];
const toPicture = ([x, y]) => [
  (x - view.left) / (stretch[0] * view.scale), (y - view.top) / (stretch[1] * view.scale),
];

function placeAt(at) {
  const [column, row] = toPicture(at).map(Math.floor);
  return column >= 0 && row >= 0 && column < about.columns && row < about.rows ? [column, row] : null;
}

function pointAt(at) {
  return points.findLast((p) => {
    const [x, y] = toScreen(p.place.map((c) => c + 0.5));
    return Math.hypot(x - at[0], y - at[1]) <= POINT_RADIUS + 2;
  });
}

function fitScale() {
  const margin = 24, wide = about.columns * stretch[0], tall = about.rows * stretch[1];
  return Math.max(1e-3, Math.min((canvas.clientWidth - 2 * margin) / wide, (canvas.clientHeight - 2 * margin) / tall));
}

function fit() {
  const scale = fitScale();
  view = {
    scale,
    left: (canvas.clientWidth - about.columns * stretch[0] * scale) / 2,
    top: (canvas.clientHeight - about.rows * stretch[1] * scale) / 2,
  };
  draw();
}

function zoom(factor, at) {
  const scale = Math.min(Math.max(view.scale * factor, fitScale() / 2), Math.max(64, fitScale()));
  const change = scale / view.scale;
  view = { scale, left: at[0] - (at[0] - view.left) * change, top: at[1] - (at[1] - view.top) * change };
  draw();
}

const middle = () => [canvas.clientWidth / 2, canvas.clientHeight / 2];

// --- The mask -------------------------------------------------------------------------------------------------------

// 1 inside and 0 outside, row by row, with a rim of zeros around: pixel [c, r] is at (r + 1) * (columns + 2) + c + 1.
function unpacked(bits) {
  const bytes = atob(bits), wide = about.columns + 2, inside = new Uint8Array(wide * (about.rows + 2));
  for (let row = 0, bit = 0; row < about.rows; row++) {
    for (let column = 0, at = (row + 1) * wide + 1; column < about.columns; column++, bit++, at++) {
      inside[at] = (bytes.charCodeAt(bit >> 3) >> (7 - (bit & 7))) & 1;
    }
  }
  return inside;
}

// The borders between pixels inside and outside, as long lines as there are.
function outlineOf(inside) {
  const path = new Path2D(), wide = about.columns + 2;
  for (let row = 0; row <= about.rows; row++) {
    for (let column = 0, start = -1, at = (row + 1) * wide + 1; column <= about.columns; column++, at++) {
      const border = column < about.columns && inside[at - wide] !== inside[at];
      if (border && start < 0) start = column;
      if (!border && start >= 0) { path.moveTo(start, row); path.lineTo(column, row); start = -1; }
    }
  }
  for (let column = 0; column <= about.columns; column++) {
    for (let row = 0, start = -1, at = wide + column + 1; row <= about.rows; row++, at += wide) {
      const border = row < about.rows && inside[at - 1] !== inside[at];
      if (border && start < 0) start = row;
      if (!border && start >= 0) { path.moveTo(column, start); path.lineTo(column, row); start = -1; }
    }
  }
  return path;
}

// What is outside gets darker.
function shadeOf(inside) {
  const shade = new OffscreenCanvas(about.columns, about.rows), context = shade.getContext("2d");
  const pixels = context.createImageData(about.columns, about.rows);
  for (let row = 0, to = 3; row < about.rows; row++) {
    let at = (row + 1) * (about.columns + 2) + 1;
    for (let column = 0; column < about.columns; column++, at++, to += 4) pixels.data[to] = inside[at] ? 0 : 115;
  }
  context.putImageData(pixels, 0, 0);
  return shade;
}

// --- Drawing --------------------------------------------------------------------------------------------------------

let drawing = false;

function draw() {
  if (drawing || !picture) return;
  drawing = true;
  requestAnimationFrame(() => { drawing = false; drawNow(); });
}

function drawNow() {
  const ratio = window.devicePixelRatio || 1;
  const wide = Math.round(canvas.clientWidth * ratio), tall = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== wide || canvas.height !== tall) { canvas.width = wide; canvas.height = tall; }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  const size = [about.columns * stretch[0] * view.scale, about.rows * stretch[1] * view.scale];
  pen.imageSmoothingEnabled = view.scale < Math.max(8, 2 * fitScale()); // from near, pixels are seen as what they are
  pen.imageSmoothingQuality = "high";
  pen.drawImage(picture, view.left, view.top, ...size);
  if (mask && maskShown) {
    pen.imageSmoothingEnabled = false;
    pen.drawImage(mask.shade, view.left, view.top, ...size);
    const path = new Path2D();
    path.addPath(mask.outline, new DOMMatrix([
      stretch[0] * view.scale, 0, 0, stretch[1] * view.scale, view.left, view.top,
    ]));
    pen.lineCap = "round";
    for (const [colour, width] of [["#000a", 4], ["#fff", 2]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.stroke(path);
    }
  }
  points.forEach(drawPoint);
  drawRuler();
  showPlace();
  canvas.dataset.view = [view.scale, view.left, view.top].join(" ");
}

function drawPoint({ place, positive }) {
  const [x, y] = toScreen(place.map((c) => c + 0.5)), arm = POINT_RADIUS / 2;
  pen.beginPath();
  pen.arc(x, y, POINT_RADIUS, 0, 2 * Math.PI);
  pen.fillStyle = positive ? "#1f9d57" : "#d43c41";
  pen.fill();
  pen.lineWidth = 4;
  pen.strokeStyle = "#0009";
  pen.stroke();
  pen.lineWidth = 2;
  pen.strokeStyle = "#fff";
  pen.stroke();
  pen.beginPath();
  pen.moveTo(x - arm, y);
  pen.lineTo(x + arm, y);
  if (positive) { pen.moveTo(x, y - arm); pen.lineTo(x, y + arm); }
  pen.stroke();
}

// A round length that is about a hundred pixels on the screen.
function drawRuler() {
  if (!about.radar) return;
  const pixelsPerMetre = (stretch[0] * view.scale) / about.spacing[0];
  const rough = 140 / pixelsPerMetre, power = 10 ** Math.floor(Math.log10(rough));
  const length = [5, 2, 1].find((n) => n * power <= rough) * power;
  $("ruler").style.width = `${length * pixelsPerMetre}px`;
  $("ruler").firstElementChild.textContent = length < 0.00999 ? `${+(length * 1e3).toPrecision(2)} mm`
    : `${+(length * 100).toPrecision(2)} cm`;
}

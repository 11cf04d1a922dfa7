"use strict";
// The annotator's page: what was asked and answered, what hands do, and what stands beside the picture. `drawing.js` has
// the picture itself.

const DEBOUNCE = 40, BUSY_SHOWN_AFTER = 150; // [ms]
const DRAG_BEGINS = 4; // [CSS pixels]

let about = null; // what the server says of the picture
let points = [], past = [], future = []; // never changed in place: undo goes back to older lists
let method = null, colours = null;
let saved = null; // the question whose answer is in the files
let pointer = null; // where it is, on the screen

// --- Asking ---------------------------------------------------------------------------------------------------------

const question = () => ({ method, points: points.map((p) => p.place), positive: points.map((p) => p.positive) });
const isSaved = () => JSON.stringify(question()) === saved;
const isTouched = () => !isSaved() && (points.length > 0 || saved !== null);
let asking = false, wanted = null, timer = null;

async function ask(address, body) {
  const options = body === undefined ? {} : { method: "POST", body: JSON.stringify(body) };
  let reply;
  try {
    reply = await fetch(address, options);
  } catch {
    throw new Error("millisight does not respond. Start it again to continue.");
  }
  const content = await reply.json();
  if (!reply.ok) throw new Error(content.error);
  return content;
}

function askForMask() {
  wanted = question();
  document.body.dataset.settled = "false";
  clearTimeout(timer);
  timer = setTimeout(answerNewest, DEBOUNCE);
}

// One question at a time; an answer to an older one than the newest is thrown away.
async function answerNewest() {
  if (asking) return;
  asking = true;
  const spinner = setTimeout(() => { $("busy").hidden = false; }, BUSY_SHOWN_AFTER);
  while (wanted) {
    const asked = wanted;
    wanted = null;
    try {
      const answer = await ask("mask", asked);
      if (!wanted) showMask(answer);
    } catch (error) {
      if (!wanted) { showMask(null); notify(error.message, true); }
    }
  }
  clearTimeout(spinner);
  $("busy").hidden = true;
  asking = false;
  document.body.dataset.settled = "true";
}

async function save() {
  if ($("save").disabled) return;
  const asked = question();
  try {
    const answer = await ask("save", asked);
    saved = JSON.stringify(asked);
    notify("");
    $("saved").textContent = `Saved ${answer.files.join(" and ")}`;
  } catch (error) {
    notify(`Not saved: ${error.message}`, true);
  }
  showState();
}

// --- Changing -------------------------------------------------------------------------------------------------------

function change(next) {
  past.push(points);
  future = [];
  setPoints(next);
}

function setPoints(next) {
  points = next;
  notify("");
  showState();
  draw();
  askForMask();
}

function undo() {
  if (!past.length) return;
  future.push(points);
  setPoints(past.pop());
}

function redo() {
  if (!future.length) return;
  past.push(points);
  setPoints(future.pop());
}

function clear() {
  if (points.length) change([]);
}

function click(at, positive) {
  const hit = pointAt(at);
  if (hit) {
    change(points.filter((p) => p !== hit));
    return;
  }
  const place = placeAt(at);
  if (place) change([...points, { place, positive }]);
}

async function setColours(name) {
  const next = new Image();
  next.src = `picture/${name}`;
  try {
    await next.decode();
  } catch {
    notify("The picture could not be loaded.", true);
    return;
  }
  colours = name;
  picture = next;
  check("colours", name);
  draw();
}

function setMethod(name) {
  method = name;
  check("methods", name);
  notify("");
  showState();
  askForMask();
}

function next(names, name) {
  return names[(names.indexOf(name) + 1) % names.length];
}

// --- What stands beside the picture ---------------------------------------------------------------------------------

function showMask(answer) {
  mask = null;
  if (answer && answer.pixels) {
    const inside = unpacked(answer.bits);
    mask = { outline: outlineOf(inside), shade: shadeOf(inside), ...answer };
  }
  if (answer && answer.note) notify(answer.note);
  $("mask").textContent = mask ? maskText(mask) : points.length ? "no mask" : "no mask yet";
  document.body.dataset.maskPixels = mask ? mask.pixels : 0;
  showState();
  draw();
}

function maskText(of) {
  const share = (100 * of.pixels) / (about.columns * about.rows);
  const area = of.area === null ? "" : `, ${+(of.area * 1e4).toPrecision(2)} cm²`;
  return `mask: ${share.toPrecision(2)} % of the picture${area}`;
}

function showState() {
  const on = points.filter((p) => p.positive).length, off = points.length - on;
  $("counts").textContent = points.length ? `${on} on the object, ${off} beside it` : "no points";
  $("hint").hidden = points.length > 0 || past.length > 0;
  $("undo").disabled = !past.length;
  $("redo").disabled = !future.length;
  $("clear").disabled = !points.length;
  $("save").disabled = isSaved() || !(mask || isTouched());
  $("save").textContent = isSaved() ? "Saved" : "Save mask and points";
  document.title = `${isTouched() ? "• " : ""}${about.name} – millisight annotate`;
}

function showPlace() {
  const place = pointer && placeAt(pointer);
  if (!place) { $("place").textContent = ""; return; }
  const cm = (metres) => (metres * 100).toFixed(1);
  $("place").textContent = about.radar ? `x ${cm(about.x[place[0]])}, y ${cm(about.y[place[1]])} cm`
    : `row ${place[1]}, column ${place[0]}`;
}

function notify(text, bad = false) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
  $("notice").classList.toggle("bad", bad);
}

function choices(id, entries, chosen) {
  const box = document.querySelector(`#${id} .choices`);
  for (const { name, hindrance } of entries) {
    const label = document.createElement("label"), input = document.createElement("input");
    const text = document.createElement("span");
    Object.assign(input, { type: "radio", name: id, value: name, disabled: Boolean(hindrance) });
    input.addEventListener("change", () => chosen(name));
    label.title = hindrance || "";
    text.textContent = name;
    label.append(input, text);
    box.append(label);
  }
}

function check(id, name) {
  for (const input of document.querySelectorAll(`#${id} input`)) input.checked = input.value === name;
}

// --- Hands ----------------------------------------------------------------------------------------------------------

let press = null; // {at, view, button, moved}
const place = (event) => [event.offsetX, event.offsetY];

canvas.addEventListener("pointerdown", (event) => {
  if (!about || press) return;
  document.activeElement.blur(); // so that keys are the page's
  canvas.setPointerCapture(event.pointerId);
  press = { at: place(event), view, button: event.button, shift: event.shiftKey, moved: false };
});

canvas.addEventListener("pointermove", (event) => {
  if (!about) return;
  pointer = place(event);
  if (press) {
    const shift = [pointer[0] - press.at[0], pointer[1] - press.at[1]];
    press.moved ||= Math.hypot(...shift) > DRAG_BEGINS;
    if (press.moved) {
      view = { ...press.view, left: press.view.left + shift[0], top: press.view.top + shift[1] };
      canvas.classList.add("moving");
      draw();
    }
  }
  canvas.classList.toggle("over", Boolean(pointAt(pointer)));
  showPlace();
});

canvas.addEventListener("pointerup", () => {
  if (!press) return;
  const { at, button, shift, moved } = press;
  press = null;
  canvas.classList.remove("moving");
  if (!moved && button !== 1) click(at, button === 0 && !shift);
});
canvas.addEventListener("pointercancel", () => { press = null; canvas.classList.remove("moving"); });
canvas.addEventListener("pointerleave", () => { pointer = null; if (about) showPlace(); });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (!about || press) return;
  const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1);
  zoom(Math.exp(-Math.max(-300, Math.min(300, pixels)) * 0.0016), place(event));
}, { passive: false });

const KEYS = {
  "ctrl+z": undo, "ctrl+shift+z": redo, "ctrl+y": redo, "ctrl+s": save,
  delete: clear, f: () => fit(), 0: () => fit(),
  "+": () => zoom(1.25, pointer || middle()), "=": () => zoom(1.25, pointer || middle()),
  "-": () => zoom(0.8, pointer || middle()),
  h: () => { maskShown = !maskShown; draw(); },
  m: () => setMethod(next(about.methods.filter((m) => !m.hindrance).map((m) => m.name), method)),
  c: () => { if (about.radar) setColours(next(about.colours, colours)); },
};

window.addEventListener("keydown", (event) => {
  if (!about || event.altKey) return;
  const control = event.ctrlKey || event.metaKey, key = event.key.toLowerCase();
  const name = `${control ? "ctrl+" : ""}${control && event.shiftKey ? "shift+" : ""}${key}`;
  if (!KEYS[name]) return;
  event.preventDefault();
  KEYS[name]();
});

window.addEventListener("beforeunload", (event) => { if (about && isTouched()) event.preventDefault(); });
$("undo").addEventListener("click", undo);
$("redo").addEventListener("click", redo);
$("clear").addEventListener("click", clear);
$("save").addEventListener("click", save);

// --- The beginning --------------------------------------------------------------------------------------------------

async function begin() {
  about = await ask("about");
  method = about.question.method;
  points = about.question.points.map((at, k) => ({ place: at, positive: about.question.positive[k] }));
  if (about.saved) saved = JSON.stringify(question());
  const least = Math.min(...about.spacing);
  stretch = about.spacing.map((s) => s / least);
  $("name").textContent = about.name;
  $("folder").textContent = about.folder;
  const size = `${about.columns} × ${about.rows} pixels`;
  const pitch = [...new Set(about.spacing.map((s) => +(s * 1e3).toPrecision(3)))].join(" × ");
  $("facts").textContent = about.radar ? `radar image, ${size} of ${pitch} mm` : `photograph, ${size}`;
  $("saved").textContent = about.saved ? "Continues the earlier annotation" : "";
  choices("methods", about.methods, setMethod);
  choices("colours", about.colours.map((name) => ({ name })), setColours);
  for (const id of ["colours", "key-colours", "ruler"]) $(id).hidden = !about.radar;
  check("methods", method);
  await setColours(about.colours[0] || "jet");
  showState();
  fit();
  new ResizeObserver(fit).observe(canvas);
  askForMask();
  stayOpen();
}

// A browser has six connections to a server, in all tabs together: one tab holds the stream that tells when millisight
// ends, and tells the others. When it is closed, the next one takes over.
function stayOpen() {
  const others = new BroadcastChannel(location.pathname);
  let over = false;
  const end = () => {
    over = true;
    notify("millisight has stopped; this page can no longer save.", true);
  };
  others.addEventListener("message", end);
  navigator.locks.request(location.pathname, () => new Promise((release) => {
    if (over) return release();
    const stream = new EventSource("open");
    stream.addEventListener("ended", () => {
      stream.close();
      others.postMessage("ended");
      end();
      release();
    });
  }));
}

begin().catch((error) => notify(error.message, true));

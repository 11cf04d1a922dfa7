"use strict";
// The live page: asks every quarter of a second how far the images are, and fetches pictures that are new.

const EVERY = 250; // [ms]
const SEEN_FROM = { z: "from above: x to the right, y up", y: "from the front: x to the right, z up",
  x: "from the side: y to the right, z up" };
const $ = (id) => document.getElementById(id);
const sections = new Map(); // by the radar's name

function section(radar) {
  if (!sections.has(radar.name)) {
    const made = $("radar").content.cloneNode(true).firstElementChild;
    made.querySelector("h2").textContent = radar.name.replace("_ghz", " GHz").replaceAll("_", " ");
    for (const view of radar.views) {
      const figure = $("view").content.cloneNode(true).firstElementChild;
      const [left, right, low, high] = view.extent.map((value) => (value * 100).toFixed(0));
      figure.querySelector("img").style.aspectRatio = (right - left) / Math.max(high - low, 1); // voxels are no cubes
      figure.dataset.axis = view.axis;
      figure.querySelector("img").alt = `Image ${SEEN_FROM[view.axis]}`;
      figure.querySelector("figcaption").textContent =
        `${SEEN_FROM[view.axis]}; ${left} to ${right} cm by ${low} to ${high} cm`;
      made.querySelector(".views").append(figure);
    }
    $("radars").append(made);
    sections.set(radar.name, { made, poses: 0 });
  }
  return sections.get(radar.name);
}

function show(radar) {
  const held = section(radar);
  if (held.poses === radar.poses) return;
  held.poses = radar.poses;
  held.made.dataset.poses = radar.poses;
  const last = radar.changes.at(-1);
  held.made.querySelector(".facts").textContent = `${radar.rows} rows, ${radar.poses} poses, ${radar.lag.toFixed(1)} s `
    + `behind the arm` + (last === undefined ? "" : `, last change ${(last * 100).toFixed(0)} %`);
  for (const figure of held.made.querySelectorAll(".views figure")) {
    const next = new Image(); // shown when it is whole, so that nothing flickers
    next.onload = () => { figure.querySelector("img").src = next.src; };
    next.src = `picture/${radar.number}/${radar.poses}/${figure.dataset.axis}`;
  }
  const most = Math.max(...radar.changes, 1e-9), count = Math.max(radar.changes.length - 1, 1);
  held.made.querySelector("polyline").setAttribute("points",
    radar.changes.map((change, i) => `${(300 * i) / count},${58 - 56 * (change / most)}`).join(" "));
}

function showState(about) {
  const rows = Math.max(0, ...about.radars.map((radar) => radar.rows));
  document.title = `${about.title}: ${rows} of ${about.rows} rows`;
  $("title").textContent = about.title;
  $("done").value = rows / about.rows;
  const whole = rows === about.rows ? ": all are scanned, and are being written" : "";
  const words = { scanning: `row ${rows} of ${about.rows}${whole}`, ending: "ending after this row, then writing what was scanned", over: about.told };
  $("state").textContent = about.state === "scanning" && !rows ? "waiting for the first row" : words[about.state];
  $("stop").disabled = about.state !== "scanning";
  document.body.dataset.state = about.state;
}

async function look() {
  let about;
  try {
    about = await (await fetch("about")).json();
  } catch {
    $("notice").textContent = "millisight has ended; the images stay as they are.";
    $("notice").hidden = document.body.dataset.state === "over";
    $("stop").disabled = true;
    return;
  }
  showState(about);
  about.radars.forEach(show);
  if (about.state !== "over") setTimeout(look, EVERY);
}

$("stop").addEventListener("click", () => {
  $("stop").disabled = true;
  fetch("stop", { method: "POST", body: "{}" }).catch(() => {});
});
look();

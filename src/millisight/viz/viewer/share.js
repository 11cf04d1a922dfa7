// A shared page: keeps its panes side by side as its camera turns, as `_layout.placed` does in the live viewer, and hides
// points under its own threshold and outside of its own limits. `shown` tells the panes; see `_share.page`.
(function () {
  const page = window.millisightPage;
  const cross = (a, b) => [a[1]*b[2] - a[2]*b[1], a[2]*b[0] - a[0]*b[2], a[0]*b[1] - a[1]*b[0]];
  const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
  const unit = a => a.map(v => v / Math.sqrt(dot(a, a)));
  const add = (a, s, b) => a.map((v, i) => v + s * b[i]);
  const count = shown.panes.length, columns = count <= 3 ? count : Math.ceil(Math.sqrt(count));
  const rows = Math.ceil(count / columns);
  const input = document.querySelector("#millisight .millisight-threshold");
  const ends = [...document.querySelectorAll("#millisight .millisight-limits input")];
  let before = "", lid = shown.lid;

  function place(m, camera, up) {
    const ahead = unit(camera.map(v => -v));
    let right = cross(ahead, up);
    right = dot(right, right) < 1e-12 ? [1, 0, 0] : unit(right);
    const above = cross(right, ahead);
    shown.panes.forEach((pane, i) => {
      const row = Math.floor(i / columns), inRow = Math.min(columns, count - row * columns);
      const beside = (i % columns - (inRow - 1) / 2) * 2 * shown.radius;
      const offset = add(right.map(v => v * beside), ((rows - 1) / 2 - row) * 2 * shown.radius, above);
      const seen = unit(add(offset, -1, camera));
      const pose = (name, wxyz, position) => {
        m.nodePoseData[name] = { wxyz: wxyz, position: position, poseUpdateState: "needsUpdate" };
      };
      pose(pane.name, unit([1 + dot(ahead, seen)].concat(cross(ahead, seen))), offset);
      pose(pane.name + "/title", [1, 0, 0, 0], above.map(v => v * shown.radius));
    });
  }

  // The limits that are set, [low, high] along each axis in the page's frame; an end of the slider is no limit.
  const limits = () => [0, 1, 2].map(axis => [0, 1].map(end => {
    const slider = ends[2 * axis + end], value = slider ? Number(slider.value) : 0;
    const free = !slider || value === Number(end ? slider.max : slider.min);
    return free ? (end ? Infinity : -Infinity) : value;
  }));

  // The points of a node, and how many levels each reaches: those with the lid where it is shown and they are there.
  const clouds = () => shown.panes.flatMap(pane => {
    const covered = lid && pane.covered;
    return [[pane, "/points", covered ? null : pane.counts], [pane, "/covered", covered ? pane.covered : null]];
  });

  function draw(m) {
    const threshold = input ? Number(input.value) : 0, within = limits();
    const cut = within.flat().some(Number.isFinite);
    for (const [pane, name, counts] of clouds()) {
      const node = m.nodeRefFromName[pane.name + name];
      if (node) node.traverse(part => {
        if (!part.isPoints) return;
        const geometry = part.geometry, xyz = geometry.attributes.position.array, kept = [];
        const strong = counts ? counts[Math.round(-threshold / shown.step)] : 0;
        for (let i = 0; cut && i < strong; i++) {
          const inside = ([low, high], axis) => {
            const at = xyz[3 * i + axis] + pane.middle[axis];
            return at >= low - 1e-6 && at <= high + 1e-6;
          };
          if (within.every(inside)) kept.push(i);
        }
        geometry.setIndex(cut ? kept : null);
        geometry.setDrawRange(0, cut ? kept.length : strong);
      });
    }
    if (!input) return;
    document.querySelector("#millisight .millisight-value").textContent = threshold + " dB";
    document.querySelector("#millisight .millisight-bar div div").style.width =
      100 * Math.min(1, Math.max(0, 1 + threshold / shown.range)) + "%";
    for (const slider of ends) slider.nextElementSibling.textContent = (100 * slider.value).toFixed(1) + " cm";
  }

  // What the page says about what it hides, and its settings as text for the address.
  function say() {
    const within = limits(), cm = v => (100 * v).toFixed(1).replace("-", "\u2212") + " cm";
    const told = within.map(([low, high], axis) => !Number.isFinite(low) && !Number.isFinite(high) ? "" : "xyz"[axis] +
      (!Number.isFinite(low) ? " under " + cm(high) : !Number.isFinite(high) ? " over " + cm(low)
        : " from " + cm(low) + " to " + cm(high))).filter(Boolean).join(", ");
    const off = shown.note && shown.panes.some(pane => pane.covered) && !lid;
    if (!ends.length) page.note(shown.fixed, "", null);
    else if (told || off) page.note((shown.note ? shown.note + (off ? ", its echo taken off" : "") + ". " : "") +
      "Shown: " + (told || "everything else") + ".", "Show everything", () => press("0"));
    else page.note(shown.note && shown.note + ".", shown.note && "Look under the lid", () => press("l"));
    const changed = ends.map(slider => slider.value);
    page.keep(new URLSearchParams({ threshold: input ? input.value : 0, lid: Number(lid), limits: changed }).toString(),
      shown.of);
  }

  function set(values, withLid) {
    ends.forEach((slider, i) => { slider.value = values[i]; });
    lid = withLid;
  }

  function press(key) {
    const under = ends.every((slider, i) => Number(slider.value) === Number(slider.defaultValue)) && lid === shown.lid;
    if (key in shown.views) page.setCamera(shown.views[key]);
    else if (key === "+" || key === "-") input && (key === "+" ? input.stepUp(2) : input.stepDown(2));
    else if (key === "0" || (key === "l" && under)) set(ends.map(slider => slider[slider.className]), true);
    else if (key === "l") set(ends.map(slider => slider.defaultValue), shown.lid);
  }

  // The point that the ray meets first: within a point's size of it, and nearest to the camera.
  function pick(ray) {
    const m = page.mutable(), within = limits();
    let best = null;
    for (const [pane, name, counts] of clouds()) {
      const node = m.nodeRefFromName[pane.name + name], frame = m.nodeRefFromName[pane.name];
      if (!node || !counts || !frame) continue;
      const turned = numbers => frame.parent.localToWorld(m.camera.position.clone().set(...numbers));
      const origin = frame.worldToLocal(turned(ray.slice(0, 3))).toArray();
      const ahead = unit(add(frame.worldToLocal(turned(add(ray.slice(0, 3), 1, ray.slice(3)))).toArray(), -1, origin));
      node.traverse(part => {
        if (!part.isPoints) return;
        const geometry = part.geometry, xyz = geometry.attributes.position.array, index = geometry.index;
        const drawn = Math.min(geometry.drawRange.count, index ? index.count : xyz.length / 3);
        for (let j = 0; j < drawn; j++) {
          const i = index ? index.array[j] : j;
          const away = [xyz[3*i] - origin[0], xyz[3*i + 1] - origin[1], xyz[3*i + 2] - origin[2]];
          const along = dot(away, ahead);
          if (along <= 0 || (best && along >= best.along)) continue;
          if (dot(away, away) - along * along > pane.size * pane.size) continue;
          best = { along, pane, db: -shown.step * counts.findIndex(reached => reached > i), at: [0, 1, 2].map(
            axis => xyz[3*i + axis] + pane.middle[axis]) };
        }
      });
    }
    if (!best) return "";
    const at = best.at.map((v, axis) => "xyz"[axis] + " " + (100 * v).toFixed(1)).join(", ");
    return (at + " cm: about " + best.db.toFixed(1) + " dB").replaceAll("-", "\u2212");
  }

  function follow() {
    requestAnimationFrame(follow);
    const m = page.mutable(), first = m && m.nodeRefFromName[shown.panes[0].name];
    if (!first || !m.camera) return;
    const root = first.parent, local = v => root.worldToLocal(v);
    const origin = local(m.camera.position.clone().set(0, 0, 0));
    const camera = local(m.camera.position.clone()).sub(origin).toArray();
    const up = local(m.camera.up.clone()).sub(origin).toArray();
    const there = clouds().filter(([pane, name]) => m.nodeRefFromName[pane.name + name]).length;
    const settings = [input && input.value, lid, ...ends.map(slider => slider.value), there].join();
    const now = [camera, up, settings].join("|");
    if (now === before) return;
    if (count > 1) place(m, camera, up);
    if (settings !== before.split("|")[2]) { draw(m); say(); }
    before = now;
    m.requestRender();
  }

  page.connect({ title: shown.title, keys: shown.keys, press });
  const told = new URLSearchParams(page.asked(shown.of) || "");
  if (input && told.has("threshold")) input.value = told.get("threshold");
  if (ends.length && told.has("limits")) set(told.get("limits").split(","), told.get("lid") === "1");
  let pointer = null;
  window.addEventListener("pointermove", event => {
    if (!pointer) requestAnimationFrame(() => {
      const ray = page.ray(pointer);
      pointer = null;
      page.say(ray ? pick(ray) : "");
    });
    pointer = event;
  });
  follow();
})();

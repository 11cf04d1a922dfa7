// Keeps the panes of a shared page side by side as its camera turns, as `_layout.placed` does in the live viewer, and
// hides points under the page's own threshold. `shown` tells the panes; see `_share.page`.
//
// `window.__viserMutable` is viser's own, in the page that carries this script; without it nothing moves, and no harm is
// done.
(function () {
  const cross = (a, b) => [a[1]*b[2] - a[2]*b[1], a[2]*b[0] - a[0]*b[2], a[0]*b[1] - a[1]*b[0]];
  const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
  const unit = a => a.map(v => v / Math.sqrt(dot(a, a)));
  const add = (a, s, b) => a.map((v, i) => v + s * b[i]);
  const count = shown.panes.length, columns = count <= 3 ? count : Math.ceil(Math.sqrt(count));
  const rows = Math.ceil(count / columns);
  const input = document.querySelector("#millisight input");
  let before = "";

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

  function hide(m) {
    const threshold = Number(input.value);
    shown.panes.forEach(pane => {
      const node = m.nodeRefFromName[pane.name + "/points"];
      if (node) node.traverse(part => {
        if (part.isPoints) part.geometry.setDrawRange(0, pane.counts[Math.round(-threshold / shown.step)]);
      });
    });
    document.querySelector("#millisight output").textContent = threshold + " dB";
    document.querySelector("#millisight .millisight-bar div div").style.width =
      100 * Math.min(1, Math.max(0, 1 + threshold / shown.range)) + "%";
  }

  function follow() {
    requestAnimationFrame(follow);
    const m = window.__viserMutable, first = m && m.nodeRefFromName[shown.panes[0].name];
    if (!first || !m.camera) return;
    const root = first.parent, local = v => root.worldToLocal(v);
    const origin = local(m.camera.position.clone().set(0, 0, 0));
    const camera = local(m.camera.position.clone()).sub(origin).toArray();
    const up = local(m.camera.up.clone()).sub(origin).toArray();
    const points = shown.panes.filter(pane => m.nodeRefFromName[pane.name + "/points"]).length;
    const now = [camera, up, input && input.value, points].join();
    if (now === before) return;
    before = now;
    if (count > 1) place(m, camera, up);
    if (input) hide(m);
    m.requestRender();
  }
  follow();
})();

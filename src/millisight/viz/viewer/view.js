// The page around viser's scene, in the live viewer and in a shared page: title and heading, one line on what is hidden,
// the place under the pointer, keys, and the view in the page's address. `live.js` and `share.js` build on it.
//
// `window.__viserMutable` is viser's own; without it the page says less, and no harm is done.
(function () {
  if (window.millisightPage) return;  // a connection made anew sends it again
  const mutable = () => window.__viserMutable;
  const root = () => mutable() && mutable().nodeRefFromName["/pane0"] && mutable().nodeRefFromName["/pane0"].parent;

  const style = document.createElement("style");
  style.textContent = `
    #millisight-head, #millisight-foot { position: fixed; left: 14px; z-index: 40; pointer-events: none; max-width: 62vw;
      color: #d5d9de; font: 14px/1.45 system-ui, sans-serif; text-shadow: 0 1px 2px #000; }
    #millisight-head { top: 10px; } #millisight-foot { bottom: 12px; left: 330px; font-variant-numeric: tabular-nums; }
    #millisight-head h1 { margin: 0; font-size: 16px; font-weight: 600; } #millisight-head h1 small { font-weight: 400;
      color: #9aa2ab; } #millisight-head button, #millisight-help button { pointer-events: auto; font: inherit;
      color: #fff; background: #1c7ed6; border: 0; border-radius: 4px; padding: 1px 9px; margin-left: 6px;
      cursor: pointer; } #millisight-head button:hover { background: #1971c2; }
    #millisight-help { position: fixed; inset: 0; margin: auto; width: 370px; height: max-content; max-height: 86vh;
      overflow: auto; z-index: 400; padding: 14px 22px 18px; border-radius: 8px; background: rgba(36, 38, 42, 0.97);
      color: #d5d9de; font: 14px/1.6 system-ui, sans-serif; box-shadow: 0 6px 30px #000a; }
    #millisight-help h2 { margin: 0 0 6px; font-size: 16px; } #millisight-help td { padding: 0 12px 0 0; }
    #millisight-help kbd { background: #4a4f57; border-radius: 3px; padding: 0 6px; font: inherit; }
    #millisight-help[hidden] { display: none; }
    .mantine-Notifications-root { top: 84px !important; }`;  // under the heading
  document.head.append(style);
  const part = (id, html) => {
    const element = document.createElement("div");
    element.id = id;
    element.innerHTML = html;
    document.body.append(element);
    return element;
  };
  const head = part("millisight-head", "<h1></h1><span></span><button hidden></button>");
  const foot = part("millisight-foot", "");
  const help = part("millisight-help", "<h2>Keys</h2><table></table>");
  help.hidden = true;
  help.addEventListener("click", () => { help.hidden = true; });
  let keys = {}, press = () => {};

  function connect(page) {
    document.title = page.title + " \u2013 millisight";
    head.querySelector("h1").textContent = page.title;
    keys = Object.fromEntries(page.keys);
    press = page.press;
    const table = help.querySelector("table");
    table.textContent = "";
    for (const [key, what] of [...page.keys, ["?", "these keys, and away with them"]]) {
      const row = table.insertRow(), cap = document.createElement("kbd");
      cap.textContent = key;
      row.insertCell().append(cap);
      row.insertCell().textContent = what;
    }
  }

  // One line on what is hidden, and what a button beside it does about it: null where nothing is.
  function note(text, action, act) {
    const button = head.querySelector("button");
    head.querySelector("span").textContent = text || "";
    button.hidden = !action;
    button.textContent = action || "";
    button.onclick = () => { button.blur(); act(); };
  }

  window.addEventListener("keydown", event => {
    const field = event.target.closest && event.target.closest("input, textarea, select, [contenteditable]");
    const typed = field && !["checkbox", "range", "radio", "button"].includes(field.type);
    if (typed || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "?" || (event.key === "Escape" && !help.hidden)) help.hidden = !help.hidden || event.key !== "?";
    else if (event.key in keys) press(event.key);
    else return;
    event.preventDefault();
  });

  // Camera -------------------------------------------------------------------------------------------------------

  const local = v => root().worldToLocal(v);
  function camera() {  // place and what it looks at, in the scene's frame
    const m = mutable(), at = m.camera.position.clone();
    return [...local(m.camera.position.clone()).toArray(), ...local(m.cameraControl.getTarget(at)).toArray()];
  }

  function setCamera(numbers) {
    const m = mutable(), place = m.camera.position.clone().set(...numbers.slice(0, 3));
    const target = place.clone().set(...numbers.slice(3));
    root().localToWorld(place);
    root().localToWorld(target);
    m.cameraControl.setPosition(place.x, place.y, place.z, false);
    m.cameraControl.setTarget(target.x, target.y, target.z, false);
    m.requestRender();
  }

  // The ray under the pointer: origin and direction, in the scene's frame; null beside the scene.
  function ray(event) {
    const m = mutable();
    if (!m || !m.camera || !root() || event.buttons || !event.target.contains(m.canvas)) return null;
    const box = m.canvas.getBoundingClientRect();
    const x = 2 * (event.clientX - box.left) / box.width - 1, y = 1 - 2 * (event.clientY - box.top) / box.height;
    if (Math.abs(x) > 1 || Math.abs(y) > 1) return null;
    const far = local(m.camera.position.clone().set(x, y, 0.5).unproject(m.camera));
    const origin = local(m.camera.position.clone());
    return [...origin.toArray(), ...far.sub(origin).normalize().toArray()];
  }

  // The address ------------------------------------------------------------------------------------------------------

  let settings = null, written = "", wanted = null, still = 0, seen = "";
  // Behind `?` where a server answers: viser takes what lies behind `#` for a part of the server's name.
  const mark = () => window.shown ? "#" : "?";
  const short = numbers => numbers.map(v => Number(v.toPrecision(5))).join(",");

  // What the address asks for, if it was made for this page: {settings, camera}; null where it asks for nothing.
  function asked(of) {
    const told = new URLSearchParams((mark() === "#" ? location.hash : location.search).slice(1));
    if (told.get("of") !== of) return null;
    const numbers = (told.get("camera") || "").split(",").map(Number);
    told.delete("of");
    told.delete("camera");
    told.delete("websocket");  // viser's own, since the server lies behind a secret
    wanted = numbers.length === 6 && numbers.every(Number.isFinite) ? numbers : null;
    return told.toString();
  }

  // From now on the address tells these settings, and where the camera is.
  function keep(text, of) {
    settings = text + (text ? "&" : "") + "of=" + of;
  }

  setInterval(() => {
    if (settings === null || !root() || !mutable().cameraControl) return;
    const now = short(camera());
    still = now === seen ? still + 1 : 0;
    seen = now;
    if (still < 2) return;  // viser puts the camera to its start first, and a user turns it
    if (wanted) {
      setCamera(wanted);
      wanted = null;
      return;
    }
    const text = settings + "&camera=" + now;
    if (text !== written) history.replaceState(null, "", mark() + (written = text));
  }, 100);

  window.millisightPage = { connect, note, ray, asked, keep, setCamera, mutable, say: text => { foot.textContent = text; } };
})();

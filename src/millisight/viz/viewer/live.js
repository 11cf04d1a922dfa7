// The live viewer's page: tells the server of keys, the pointer and the address through a hidden control of viser's, and
// shows what the server tells. `page` is what the server says of itself; see `_page_link.PageLink`.
(function () {
  const link = window.millisight.link = window.millisight.link || { count: 0, awaited: false };
  link.tell = what => {
    link.count += 1;  // viser passes on only what differs
    const value = JSON.stringify({ ...what, count: link.count });
    window.millisight.mutable().sendMessage({ type: "GuiUpdateMessage", uuid: page.uuid, updates: { value } });
  };
  window.millisight.connect({ ...page, press: key => link.tell({ key }) });
  window.millisight.told = told => {
    if ("picked" in told) {
      link.awaited = false;
      window.millisight.say(told.picked);
    }
    if ("address" in told) {
      window.millisight.keep(told.address, page.of);
      window.millisight.note(told.note, told.action, () => link.tell({ key: told.key }));
    }
  };
  if (!link.asked) {  // the address counts when the page opens, and not when it is connected anew
    link.asked = true;
    link.tell({ address: window.millisight.asked(page.of) });
    window.addEventListener("pointermove", event => {
      const ray = window.millisight.ray(event), now = performance.now();
      if (!ray) return window.millisight.say("");
      if (link.awaited && now - link.since < 1000) return;
      link.awaited = true;
      link.since = now;
      link.tell({ ray });
    });
  }
})();

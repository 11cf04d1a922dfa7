// The live viewer's page: tells the server of keys, the pointer and the address through a hidden control of viser's, and
// shows what the server tells. `page` is what the server says of itself; see `_page_link.PageLink`.
(function () {
  const link = window.millisightPage.link = window.millisightPage.link || { count: 0, awaited: false };
  link.tell = what => {
    link.count += 1;  // viser passes on only what differs
    const value = JSON.stringify({ ...what, count: link.count });
    window.millisightPage.mutable().sendMessage({ type: "GuiUpdateMessage", uuid: page.uuid, updates: { value } });
  };
  window.millisightPage.connect({ ...page, press: key => link.tell({ key }) });
  window.millisightPage.told = told => {
    if ("picked" in told) {
      link.awaited = false;
      window.millisightPage.say(told.picked);
    }
    if ("address" in told) {
      window.millisightPage.keep(told.address, page.of);
      window.millisightPage.note(told.note, told.action, () => link.tell({ key: told.key }));
    }
  };
  if (!link.asked) {  // the address counts when the page opens, and not when it is connected anew
    link.asked = true;
    link.tell({ address: window.millisightPage.asked(page.of) });
    window.addEventListener("pointermove", event => {
      const ray = window.millisightPage.ray(event), now = performance.now();
      if (!ray) return window.millisightPage.say("");
      if (link.awaited && now - link.since < 1000) return;
      link.awaited = true;
      link.since = now;
      link.tell({ ray });
    });
  }
})();

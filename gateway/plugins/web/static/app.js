// Begins the page: the head, the veil, and one view at a time.

import { setClass, setText } from "./dom.js";
import { age, clock } from "./format.js";
import { connect, onChange, store, titleOf } from "./store.js";
import { Events } from "./views/events.js";
import { GatewayPage } from "./views/gateway.js";
import { Lines } from "./views/lines.js";
import { refreshAccount } from "./views/login.js";
import { Overview, failures } from "./views/overview.js";
import { Starter } from "./views/starter.js";
import { Wall } from "./views/wall.js";

const VIEWS = { "": Overview, lines: Lines, events: Events, gateway: GatewayPage, wall: Wall };
const YOUNG_MS = 2500; // after the page was opened, silence is not yet a fault

const main = document.getElementById("main");
const live = document.getElementById("live");
const veil = document.getElementById("veil");
const alarms = document.getElementById("alarms");
const openedAt = Date.now();
let view = null;

function route() {
  const [page, name] = location.hash.replace(/^#\//, "").split("/");
  view?.close();
  try {
    view = page === "starter" && name ? new Starter(decodeURIComponent(name)) : new (VIEWS[page] ?? Overview)();
  } catch {
    view = new Overview(); // an address that cannot be read
  }
  document.body.classList.toggle("wall", view instanceof Wall);
  main.replaceChildren(view.element);
  refresh(null, [], true);
  window.scrollTo(0, 0);
  for (const tab of document.querySelectorAll(".tabs a")) {
    const isHere = tab.getAttribute("href") === (location.hash || "#/");
    if (isHere) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
}

function refresh(changed = null, messages = [], isNow = false) {
  const isLive = store.isLive();
  head(isLive);
  announce(messages);
  view?.refresh(isNow, changed, messages);
}

function head(isLive) {
  const status = store.topic("gateway/status") ?? {};
  const isYoung = Date.now() - openedAt < YOUNG_MS && !store.gen;
  setText(document.getElementById("brand"), store.name || "Starter Gateway");
  const faults = failures();
  document.title = `${isLive ? (faults ? `(${faults}) ` : "") : "NOT LIVE – "}${view?.title ?? ""} – ${store.name || "Starter Gateway"}`;
  setText(live, isLive ? "LIVE" : isYoung ? "connecting" : "NOT LIVE");
  setClass(live, isLive ? "live" : isYoung ? "live wait" : "live not");
  setText(document.getElementById("clock"), store.gen ? clock(new Date(store.now()).toISOString()) : "");
  const broker = document.getElementById("broker");
  setText(broker, status.state ? brokerText(status) : "");
  setClass(broker, status.state === "online" ? "fact usual" : "fact");
  document.body.classList.toggle("not-live", !isLive && !isYoung);
  veil.hidden = isLive || isYoung;
  if (!veil.hidden) {
    const silence = store.silentS();
    const why = store.refusal || (silence === Infinity ? "nothing has come from the gateway yet" : `nothing from the gateway for ${age(silence)}`);
    setText(veil, `NOT LIVE: ${why}. Values are old.${view instanceof Wall ? "" : " STOP still tries."}`);
  }
  refreshAccount();
}

function brokerText(status) {
  return status.state === "online" ? "broker connected" : `gateway ${status.state}${status.reason ? `: ${status.reason}` : ""}`;
}

function announce(messages) {
  for (const { topic, payload } of messages) {
    if (payload.severity === "error") setText(alarms, `${titleOf(topic.split("/")[1])}: ${payload.text}`);
  }
}

onChange((changed, messages) => refresh(changed, messages));
window.addEventListener("hashchange", route);
setInterval(() => refresh(new Set()), 1000);
route();
if (!location.hash.startsWith("#/starter/")) connect(null);

// Alarms that stand, events, and who did what.

import { h, table } from "../dom.js";
import { dateTime, words } from "../format.js";
import { store, titleOf } from "../store.js";
import { alarmName, summary } from "./overview.js";

const MOST = 300;

export class Events {
  constructor() {
    this.title = "Events";
    this.search = h("input", { type: "search", placeholder: "Filter", "aria-label": "Filter events", oninput: () => this.refresh(true) });
    this.kind = h("select", { "aria-label": "Kind", onchange: () => this.refresh(true) },
      ["everything", "warnings and errors", "commands"].map((text) => h("option", { value: text }, text)));
    this.alarms = h("div");
    this.place = h("div");
    this.element = h("div", {}, h("h1", {}, "Events"),
      h("section", {}, h("h2", {}, "Standing now"), this.alarms),
      h("section", {}, h("h2", {}, "What happened"),
        h("div", { class: "tools" }, this.search, this.kind, h("a", { href: "api/v1/events.csv", download: "events.csv" }, "CSV")), this.place));
    this.shown = "";
  }

  close() {}

  refresh() {
    const wanted = this.search.value.trim().toLowerCase();
    const rows = store.messages.filter(({ topic }) => !topic.startsWith("result/")).map(rowOf)
      .filter((row) => this.fits(row) && row.cells.join(" ").toLowerCase().includes(wanted))
      .map((row, index) => ({ ...row, index })).sort((a, b) => b.at - a.at || b.index - a.index).slice(0, MOST);
    const alarms = Object.keys(store.starters).flatMap((name) => summary(name).alarms.map(([code, alarm]) => [
      dateTime(alarm.time), h("a", { href: `#/starter/${encodeURIComponent(name)}` }, titleOf(name)), [alarmName(code, alarm), alarm.severity].filter(Boolean).join(", "),
      alarm.text, alarm.acknowledged ? `${alarm.acknowledged.by}, ${dateTime(alarm.acknowledged.time)}` : ""]));
    const shape = JSON.stringify([rows, alarms.map((row) => [row[0], row[1].textContent, ...row.slice(2)])]);
    if (shape === this.shown) return;
    this.shown = shape;
    this.alarms.replaceChildren(alarms.length ? table("Standing faults and alarms", ["since", "starter", "what", "text", "acknowledged by"], alarms) : h("p", {}, "No fault and no alarm."));
    this.place.replaceChildren(rows.length ? table("Newest first", ["time", "of", "what", "text"], rows.map((row) => row.cells)) : h("p", {}, "Nothing yet."));
  }

  fits(row) {
    if (this.kind.value === "commands") return row.isCommand;
    return this.kind.value === "everything" || ["warning", "error"].includes(row.severity);
  }
}

function rowOf({ topic, payload }) {
  if (topic === "audit") {
    const who = payload.source ? `${payload.client} (${payload.source})` : payload.client;
    return { isCommand: true, severity: "info", at: Date.parse(payload.time), cells: [dateTime(payload.time), titleOf(payload.starter ?? ""), words(`${payload.verb} ${payload.decision}`), `${who}${payload.code && payload.code !== "ok" ? ` [${payload.code}]` : ""}`] };
  }
  const starter = topic.startsWith("starter/") ? topic.split("/")[1] : "gateway";
  const what = payload.severity === "info" ? words(payload.code) : `${payload.severity}: ${words(payload.code)}`;
  const text = payload.text.replace(/^(fault|alarm),? /, ""); // the column before it says so
  return { isCommand: false, severity: payload.severity, at: Date.parse(payload.time), cells: [dateTime(payload.time), titleOf(starter), what, text] };
}

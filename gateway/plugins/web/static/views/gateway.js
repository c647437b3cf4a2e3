// The gateway itself: its ways out, its clock, its checks.

import { post } from "../api.js";
import { h, table } from "../dom.js";
import { age, dateTime, number } from "../format.js";
import { store } from "../store.js";

export class GatewayPage {
  constructor() {
    this.title = "Gateway";
    this.facts = h("div", { class: "facts" });
    this.outputs = { check: h("pre", { tabindex: "0", hidden: true }), doctor: h("pre", { tabindex: "0", hidden: true }) };
    this.element = h("div", {}, h("h1", {}, "Gateway"), this.facts,
      ...Object.entries(this.outputs).map(([name, output]) => h("section", {}, h("h2", {}, name === "check" ? "Check of the configuration" : "Doctor: this machine and the starters' settings"),
        h("button", { type: "button", onclick: (event) => this.run(name, output, event.target) }, `Run ${name}`), output)),
      h("section", {}, h("h2", {}, "Diagnostics"), h("p", {}, h("a", { href: "api/v1/diagnostics.json", download: "diagnostics.json" }, "Everything for a report of a problem, without secrets"))));
    this.shown = "";
  }

  close() {}

  refresh() {
    const status = store.topic("gateway/status") ?? {};
    const info = store.topic("gateway/info") ?? {};
    const outbox = store.topic("gateway/outbox") ?? {};
    const rows = [
      ["state", [status.state, status.reason].filter(Boolean).join(": ")], ["since", dateTime(status.since)],
      ["version", `${store.version}, contract ${info.contract ?? ""}`], ["MQTT", info.mqtt_version ? `version ${info.mqtt_version}` : "not connected yet"],
      ["base topic", store.base], ["gateway's clock", dateTime(new Date(store.now()).toISOString())],
      ["this browser's clock", Math.abs(store.aheadMs) < 2000 ? "the same" : `${age(Math.abs(store.aheadMs) / 1000)} ${store.aheadMs > 0 ? "behind" : "ahead"}`],
      ["outbox", `${number(outbox.depth ?? 0)} messages, ${number(outbox.bytes ?? 0)} bytes, oldest ${number(outbox.oldest_s ?? 0, "s")}`],
      ["dropped, refused, reconnects", [outbox.dropped, outbox.refused, outbox.reconnects].map((each) => each ?? 0).join(", ")],
      ["operators", (info.operators ?? []).map((operator) => `${operator.client} (${operator.may.join(", ")})`).join("; ") || "none: read-only"],
      ["notice", info.notice ?? "not a safety function"],
    ];
    const shape = JSON.stringify(rows);
    if (shape === this.shown) return;
    this.shown = shape;
    this.facts.replaceChildren(table("This gateway", ["", ""], rows));
  }

  async run(name, output, button) {
    button.disabled = true;
    output.hidden = false;
    output.textContent = "running …";
    try {
      const result = await post(`api/v1/${name}`, {}, { withinMs: 120000 });
      output.textContent = `${result.output}\n(exit code ${result.code}, ${number(result.took_s, "s")})`;
    } catch (error) {
      output.textContent = error.message;
    }
    button.disabled = false;
  }
}

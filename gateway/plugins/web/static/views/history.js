// The last hour, the last starts over the baseline, and what came before each trip.

import { get } from "../api.js";
import { h, table } from "../dom.js";
import { dateTime, number } from "../format.js";
import { plotStarts, plotTime } from "../plot.js";

const EVERY_MS = 10000;
const OVERLAID = 5; // starts beside the baseline

export class History {
  constructor(name) {
    this.name = name;
    this.plot = h("div", { class: "plot" });
    this.hour = h("section", { class: "hour" }, h("h2", {}, "Last hour"), this.plot); // stands beside the state
    this.starts = h("div", { class: "plot" });
    this.startTable = h("div");
    this.trips = h("div");
    this.element = h("div", {},
      h("section", {}, h("h2", {}, "Last starts"), this.starts, this.startTable),
      h("section", {}, h("h2", {}, "Trips"), this.trips));
    this.startsShown = "";
    this.tripsShown = "";
    this.timer = setInterval(() => document.hidden || this.load(), EVERY_MS);
    this.load();
  }

  close() {
    clearInterval(this.timer);
  }

  async load() {
    if (this.isLoading) return;
    this.isLoading = true;
    let data;
    try {
      data = await get(`api/v1/starter/${encodeURIComponent(this.name)}/history`);
    } catch {
      return;
    } finally {
      this.isLoading = false;
    }
    const { plots, starts = [], trips = [] } = data;
    if (plots) await plotTime(this.plot, plots);
    const startIds = starts.map((start) => start.id).join();
    if (startIds !== this.startsShown || !this.startTable.firstChild) await this.drawStarts(starts);
    this.startsShown = startIds;
    const tripIds = trips.map((trip) => trip.id).join();
    if (tripIds !== this.tripsShown || !this.trips.firstChild) this.drawTrips(trips);
    this.tripsShown = tripIds;
  }

  async drawStarts(starts) {
    this.starts.hidden = !starts.length;
    if (!starts.length) {
      this.startTable.replaceChildren(h("p", {}, "No start has been recorded yet."));
      return;
    }
    const baseline = starts.find((start) => start.is_baseline);
    const curves = [...new Set([...(baseline ? [baseline] : []), ...starts.slice(-OVERLAID)])].filter((start) => start.samples);
    await plotStarts(this.starts, curves);
    const heads = ["time", "cause", "outcome", "acceleration", "peak", "mean", "I²t", "rate"];
    this.startTable.replaceChildren(table("Starts, newest first", heads, [...starts].reverse().map((start) => [
      dateTime(start.time) + (start.is_baseline ? " (baseline)" : ""), causeOf(start), start.outcome?.replaceAll("_", " "),
      number(start.acceleration_s ?? null, "s"), number(start.peak_a ?? null, "A"), number(start.mean_a ?? null, "A"),
      number(start.i2t_a2s ?? null, "A²s"), number(start.rate_hz ?? null, "Hz"),
    ])));
  }

  drawTrips(trips) {
    if (!trips.length) {
      this.trips.replaceChildren(h("p", {}, "No trip has been recorded yet."));
      return;
    }
    this.trips.replaceChildren(...[...trips].reverse().map((trip) => h("details", {},
      h("summary", {}, `${dateTime(trip.time)}  ${trip.code?.toUpperCase() ?? ""} ${trip.text ?? ""}`),
      before(trip), atFault(trip))));
  }
}

function causeOf(start) {
  const { source, client } = start.cause ?? {};
  return client ? `${source} (${client})` : source ?? "unknown";
}

function before(trip) {
  const times = trip.readings?.t_s ?? [];
  const points = Object.entries(trip.readings?.points ?? {});
  if (!times.length || !points.length) return h("p", {}, "No values were read before it.");
  const from = Math.max(0, times.length - 12);
  const heads = ["seconds", ...points.map(([name]) => name)];
  return table("Before the trip", heads, times.slice(from).map((time, index) => [time.toFixed(1), ...points.map(([, values]) => number(values[from + index] ?? null))]));
}

function atFault(trip) {
  const rows = Object.entries(trip.at_fault ?? {}).map(([code, value]) => [code, value.name ?? "", number(value.value ?? null, value.unit ?? "")]);
  return rows.length ? table("Stored by the starter at the fault", ["code", "name", "value"], rows) : null;
}

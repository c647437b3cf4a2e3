// The last hour, the last starts over the baseline, and what came before each trip.

import { get } from "../api.js";
import { h, table } from "../dom.js";
import { dateTime, number } from "../format.js";
import { plotStarts, plotTime, plotTrip } from "../plot.js";
import { store } from "../store.js";

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
      this.before(trip), atFault(trip))));
  }

  /** The readings before a trip: drawn once the trip is opened, with all of them in a table below. */
  before(trip) {
    const readings = trip.readings ?? {};
    if (!readings.t_s?.length || !Object.keys(readings.points ?? {}).length) return h("p", {}, "No values were read before it.");
    const points = store.topic(`starter/${this.name}/info`)?.points ?? {};
    const units = Object.fromEntries(Object.entries(points).map(([name, about]) => [name, about.unit ?? ""]));
    const place = h("div", { class: "plot" });
    const box = h("div", {}, h("h3", {}, "Before the trip"), place, h("details", {}, h("summary", {}, "All readings"), readingsTable(readings)));
    new ResizeObserver((_, observer) => {
      if (!place.clientWidth) return; // still closed
      observer.disconnect();
      plotTrip(place, readings, units);
    }).observe(place);
    return box;
  }
}

function causeOf(start) {
  const { source, client } = start.cause ?? {};
  return client ? `${source} (${client})` : source ?? "unknown";
}

function readingsTable({ t_s: times, points }) {
  const columns = Object.entries(points);
  return table("Readings before the trip", ["seconds", ...columns.map(([name]) => name)],
    times.map((time, index) => [time.toFixed(1), ...columns.map(([, values]) => (values[index] === null || values[index] === undefined ? "" : number(values[index])))]));
}

function atFault(trip) {
  const rows = Object.entries(trip.at_fault ?? {}).map(([code, value]) => [code, value.name ?? "", number(value.value ?? null, value.unit ?? "")]);
  return rows.length ? table("Stored by the starter at the fault", ["code", "name", "value"], rows) : null;
}

// What the gateway has sent, and whether it still sends.

const LIVE_MS = 3000; // three beats
const MOST_MESSAGES = 500;

export const store = {
  gen: 0,
  name: "",
  base: "",
  version: "",
  token: "",
  session: { user: null, client: null, csrf: null, logins: false },
  starters: {},
  lines: {},
  groups: {},
  topics: new Map(),
  ofStarter: new Map(), // the same by starter, for those of starters
  messages: [],
  actions: null,
  scope: null,
  receivedAt: null, // by this browser's clocks: its wall clock, and its steady clock
  aheadMs: 0, // how far the gateway's clock is ahead of it
  isBroken: true,
  ages: new Map(), // of the last reply of each starter, in seconds, when they came
  agesAt: null,
  refusal: "", // why the gateway opens no stream
  isLeaving: false, // a logout of this tab's own is under way
  topic(name) {
    return this.topics.get(name) ?? null;
  },
  /** Everything of a starter below a prefix, "alarm/" or "value/". */
  below(starter, prefix) {
    const found = [];
    for (const [rest, payload] of this.ofStarter.get(starter) ?? []) if (rest.startsWith(prefix)) found.push([rest.slice(prefix.length), payload]);
    return found;
  },
  isLive() {
    return !this.isBroken && this.silentS() * 1000 < LIVE_MS && this.topic("gateway/status") !== null;
  },
  /** Seconds since the last event, infinite before the first: the wall clock may be set back, the steady one halts while a laptop sleeps. */
  silentS() {
    return this.receivedAt ? elapsedMs(this.receivedAt) / 1000 : Infinity;
  },
  now() {
    return Date.now() + this.aheadMs;
  },
  ageS(time) {
    return time ? (this.now() - Date.parse(time)) / 1000 : null;
  },
  /** Seconds since the last reply of a starter; null when none has come. */
  replyAgeS(name) {
    const age = this.ages.get(name);
    return age === null || age === undefined ? null : age + elapsedMs(this.agesAt) / 1000;
  },
};

/** What people call a starter, a line or a group. */
export function titleOf(name, kind = "starters") {
  return store[kind][name]?.title ?? name;
}

/** A moment, for `elapsedMs`. */
export function moment() {
  return { wall: Date.now(), steady: performance.now() };
}

/** Milliseconds since a moment, by the clock that says more. */
export function elapsedMs(since) {
  return Math.max(Date.now() - since.wall, performance.now() - since.steady);
}

const listeners = new Set();
let waiting = null;

/** Calls `listener(changed topics or null for all, new messages)` after each change; returns what ends that. */
export function onChange(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

let changed = new Set();
let isAll = false;
let fresh = [];

function notify(topics, messages = []) {
  if (topics === null) isAll = true;
  else topics.forEach((topic) => changed.add(topic));
  fresh.push(...messages);
  if (waiting !== null) return;
  waiting = setTimeout(() => {
    waiting = null;
    const [what, news] = [isAll ? null : changed, fresh];
    changed = new Set();
    isAll = false;
    fresh = [];
    for (const listener of [...listeners]) listener(what, news);
  }, 0);
}

function received(data) {
  store.receivedAt = moment();
  store.isBroken = false;
  store.refusal = "";
  if (data.gen !== undefined) store.gen = data.gen;
  if (data.token) store.token = data.token;
  if (data.time) store.aheadMs = Date.parse(data.time) - Date.now();
  if (data.ages) {
    const names = Object.keys(data.lines ? data.starters : store.starters); // only the whole has lines
    store.ages = new Map(names.map((name, index) => [name, data.ages[index]]));
    store.agesAt = moment();
  }
}

function put(topic, payload) {
  const [kind, starter] = topic.split("/", 2);
  const all = [[store.topics, topic]];
  if (kind === "starter") {
    if (!store.ofStarter.has(starter)) store.ofStarter.set(starter, new Map());
    all.push([store.ofStarter.get(starter), topic.slice(kind.length + starter.length + 2)]);
  }
  for (const [topics, name] of all) {
    if (payload === null) topics.delete(name);
    else topics.set(name, payload);
  }
}

const logouts = new Set();

/** Calls `listener(user)` when a login has ended that this tab did not end itself. */
export function onLogout(listener) {
  logouts.add(listener);
}

function takeSession(session) {
  const before = store.session.user;
  store.session = session;
  if (before && !session.user && !store.isLeaving) for (const listener of logouts) listener(before);
}

const loggedOut = () => ({ ...store.session, user: null, client: null, csrf: null });

/** The gateway does not know this login any more. */
export function sessionEnded() {
  if (!store.session.user) return;
  takeSession(loggedOut());
  connect();
  notify(null);
}

function takeSnapshot(data) {
  received(data);
  takeSession(data.session);
  Object.assign(store, {
    name: data.gateway, base: data.base, version: data.version, starters: data.starters,
    lines: data.lines, groups: data.groups, actions: data.actions, topics: new Map(), ofStarter: new Map(),
    messages: data.messages,
  });
  for (const [topic, payload] of Object.entries(data.topics)) put(topic, payload);
  notify(null);
}

function takeChange(data) {
  received(data);
  for (const [topic, payload] of Object.entries(data.topics ?? {})) {
    put(topic, payload);
  }
  if (data.starters) Object.assign(store.starters, data.starters);
  if (data.actions) store.actions = data.actions;
  const messages = data.messages ?? [];
  store.messages = [...store.messages, ...messages].slice(-MOST_MESSAGES);
  notify(data.starters ? null : Object.keys(data.topics ?? {}), messages);
}

let source = null;

/** Restarts the stream: of one starter in full where `scope` names it; null: of the overview. */
export function connect(scope = store.scope) {
  disconnect();
  store.scope = scope;
  source = new EventSource(`api/v1/events${scope ? `?starter=${encodeURIComponent(scope)}` : ""}`);
  source.addEventListener("snapshot", (event) => takeSnapshot(JSON.parse(event.data)));
  source.addEventListener("change", (event) => takeChange(JSON.parse(event.data)));
  source.addEventListener("beat", (event) => {
    received(JSON.parse(event.data));
    notify([]);
  });
  source.addEventListener("session", sessionEnded);
  source.onerror = () => {
    store.isBroken = true;
    notify([]);
    if (source?.readyState === EventSource.CLOSED) refused(source);
  };
}

/** Asks why a stream was refused, which EventSource does not say, and tries again. */
async function refused(stream) {
  try {
    const response = await fetch(stream.url, { cache: "no-store", signal: AbortSignal.timeout(3000) });
    if (response.ok) response.body.cancel();
    else store.refusal = (await response.json()).text ?? "";
  } catch {
    store.refusal = ""; // no gateway answers
  }
  notify([]);
  setTimeout(() => source === stream && connect(), 3000);
}

function disconnect() {
  source?.close();
  source = null;
}

// A hidden page needs no stream: browsers allow six connections to a host.
document.addEventListener("visibilitychange", () => {
  if (document.hidden) {
    disconnect();
    store.isBroken = true;
    notify([]);
  } else connect();
});

// A page that comes back by the browser's back button is as old as it was left.
window.addEventListener("pageshow", (event) => {
  if (!event.persisted) return;
  store.isBroken = true;
  connect();
});

// A login or logout in one tab is one in all: they share the cookie.
const tabs = new BroadcastChannel("session");
tabs.onmessage = () => document.hidden || connect();

export function setSession(session) {
  store.session = session;
  connect();
  notify(null);
  tabs.postMessage("changed");
}

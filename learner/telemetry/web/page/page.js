// The page of a run. It only asks, and all that it is told it shows as text.

import {Chart, minus} from "/charts.js";

const SCORE = "play/train_reward";
const FIRST = [
  SCORE, "learning/mean_max_q", "learning/loss",
  "stream/steps_per_second", "learning/updates_per_second",
];
const STATE_EVERY = 1000, VIEW_EVERY = 200, ROOM_EVERY = 1000;
const $ = id => document.getElementById(id);
const charts = new Map();
const curves = {version: -1, count: 0, steps: [], values: {}}, epochs = [];
const text = (id, told) => { $(id).textContent = told ?? ""; };

function element(name, told, more = {}) {
  const made = document.createElement(name);
  if (told !== undefined) made.textContent = told;
  return Object.assign(made, more);
}

async function ask(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

const pause = ms => new Promise(done => setTimeout(done, ms));

// ---------------------------------------------------------------- figures and curves

async function watchRun() {
  let phase = "";
  for (;;) {
    try {
      const state = await ask(`/state?version=${curves.version}&count=${curves.count}&rows=${epochs.length}`);
      if (state.run) show(state);
      phase = state.run ? state.run.phase : "starting …";
      text("link", phase);
      $("link").className = "on";
    } catch {
      const finished = phase === "finishing";  // it had all its steps
      text("link", finished ? "the run has ended" : "no answer: has the run ended?");
      $("link").className = finished ? "" : "off";
    }
    await pause(STATE_EVERY);
  }
}

function show(state) {
  const {run} = state;
  document.title = `${run.name} · ${run.game || run.env} · ALE-Robot`;
  text("env", run.env);
  text("game", run.game);
  text("about", `run ${run.name} · ${run.preset} preset · ${run.device}`);
  $("viewpoints").hidden = !run.robot;
  $("progress").replaceChildren(...state.progress.map(progress));
  $("panels").replaceChildren(...Object.entries(state.panels).map(panel));
  text("alive", `${state.alive[0]} of ${state.alive[1]} alive${state.troubles && ", "}${state.troubles}`);
  text("verdict", state.verdict);
  showActors(state.actors, run.join);
  $("checks").replaceChildren(...state.checks.map(check));
  showEvents(state.events);
  showFilms(state.films);
  choices(state.actors);
  takePoints(state);
}

function progress({label, share, text: told, note, meaning}) {
  const box = element("div", undefined, {title: meaning});
  const bar = element("progress", undefined, {value: share ?? 0});
  bar.setAttribute("aria-label", label);
  box.append(element("b", label), element("span", [told, note].filter(Boolean).join(" · ")), bar);
  return box;
}

function panel([title, rows]) {
  const box = element("section", undefined, {className: "card"}), list = element("dl");
  for (const row of rows) {
    list.append(element("dt", row.label, {title: row.meaning}), element("dd", row.text));
  }
  box.append(element("h2", title), list);
  return box;
}

function check({name, passed, value, bound, why}) {
  const colour = passed === null ? "" : passed ? "green" : "red";
  const row = element("tr", undefined, {className: colour, title: `if not: ${why}`});
  row.append(element("td", name), element("td", value), element("td", bound));
  if (passed === false) row.firstChild.append(element("small", why));  // a phone has no pointer to rest
  return row;
}

const COLUMNS = {
  name: ["name", "Name of the process"], role: ["role", "It trains, or tests each epoch"],
  machine: ["machine", "Host on which it runs"], age: ["age", "Time since its start"],
  steps: ["steps", "Steps that it played"], rate: ["steps/s", "Steps per second in the last ten"],
  epsilon: ["ε", "Share of random actions"],
  weights: ["updates behind", "Updates between its weights and the newest published"],
  throttled: ["throttled", "Share of the last ten seconds in which it waited for the learner"],
  cores: ["CPU", "Cores that it keeps busy"], memory: ["memory", "Without file pages"],
  silent: ["silent", "Time since it was last heard"], trouble: ["", "What went wrong with time"],
};

function showActors(actors, join) {
  if (!actors.length) {
    const row = element("tr");
    row.append(element("td", join ? `none yet; start one: ${join}` : "none yet"));
    $("actors").replaceChildren(row);
    return;
  }
  const head = element("tr");
  for (const [label, title] of Object.values(COLUMNS)) head.append(element("th", label, {title}));
  const rows = actors.map(actor => {
    const row = element("tr", undefined, {className: actor.gone});
    for (const column of Object.keys(COLUMNS)) row.append(element("td", actor[column]));
    return row;
  });
  $("actors").replaceChildren(head, ...rows);
}

function showEvents(events) {
  const rows = events.toReversed().map(({time, text: told}) => {
    const row = element("li");
    row.append(element("time", new Date(time * 1000).toTimeString().slice(0, 8)), told);
    return row;
  });
  $("events").replaceChildren(...rows);
}

const films = new Map();
function showFilms(names) {
  if (names.join("/") === [...films.keys()].join("/")) return;
  const known = new Map(films);  // one that plays goes on when another comes
  films.clear();
  for (const name of names) films.set(name, known.get(name) ?? filmOf(name));
  $("cinema").hidden = !names.length;
  $("films").replaceChildren(...[...films.values()].toReversed());
}

function filmOf(name) {
  const figure = element("figure");
  const film = element("video", undefined, {controls: true, preload: "metadata", src: `/films/${encodeURIComponent(name)}`});
  figure.append(film, element("figcaption", name));
  return figure;
}

function takePoints({curves: news, about, epochs: {start, rows}, random}) {
  if (news.start === 0) {
    curves.steps = [];
    curves.values = {};
  }
  curves.steps.push(...news.steps);
  for (const [key, values] of Object.entries(news.values)) (curves.values[key] ??= []).push(...values);
  epochs.splice(start, Infinity, ...rows);
  curves.version = news.version;
  curves.count = curves.steps.length;
  if (about && !charts.size) {
    const rest = Object.keys(about).filter(key => !FIRST.includes(key));
    about[SCORE].label = "score: training games (line) and tests (dots)";
    for (const key of FIRST) charts.set(key, new Chart($("curves"), about[key]));
    for (const key of rest) charts.set(key, new Chart($("more"), about[key]));
  }
  const tests = epochs.filter(each => each.phase === "test" && each.score !== null);
  const dots = tests.map(each => [
    each.agent_steps, each.score,
    `test of epoch ${each.epoch}: ${minus(each.score.toFixed(2))} (${minus(String(each.least))} to ${minus(String(each.most))}, ${each.games} games)`,
  ]);
  for (const [key, chart] of charts) {
    const line = curves.steps.map((step, i) => [step, curves.values[key][i]]).filter(point => point[1] !== null);
    if (key === SCORE) {
      const before = epochs.filter(each => each.phase !== "test" && each.score !== null)
        .map(each => [each.agent_steps, each.score]).filter(point => !line.length || point[0] < line[0][0]);
      chart.set([...before, ...line], dots, random);
    } else chart.set(line);
  }
}

// ---------------------------------------------------------------- live pictures

let viewpoint = "none";
let pictured = "none"; // viewpoint of the picture that is shown

function choices(actors) {
  const names = actors.filter(actor => !actor.gone).map(actor => `${actor.role}/${actor.name}`);
  const shown = [...$("who").options].map(option => option.value);
  if (names.join() === shown.join()) return;
  const before = $("who").value;
  $("who").replaceChildren(...names.map(value => element("option", value.split("/")[1], {value})));
  if (names.includes(before)) $("who").value = before;
}

for (const button of $("viewpoints").children) {
  button.addEventListener("click", () => {
    viewpoint = button.value;
    for (const each of $("viewpoints").children) each.setAttribute("aria-pressed", each === button);
  });
}
$("who").addEventListener("change", () => { $("stream").value = "0"; });

async function watchActor() {
  for (;;) {
    const who = $("who").value, asked = viewpoint, stream = $("stream").value || 0;
    if (who && !document.hidden) {
      try {
        showView(await ask(`/view/${who}?stream=${stream}&viewpoint=${asked}`), asked);
      } catch {
        silent("It shows nothing.");
      }
    } else if (!who) silent("Nobody plays now.");
    await pause(asked === "none" ? VIEW_EVERY : ROOM_EVERY);
  }
}

function silent(told) {
  text("silence", told);
  $("silence").hidden = false;
}

function source(id, data) {
  if (data) $(id).src = data;
  else $(id).removeAttribute("src");
}

function showView(view, asked) {
  if (view === null) {
    if (pictured !== asked) source("picture", null);
    silent("No new picture: it waits for the learner, or plays nothing now.");
    return;
  }
  $("silence").hidden = true;
  pictured = asked;
  const outside = asked !== "none" && view.room;
  source("picture", outside ? view.room : view.picture || view.frame);
  source("camera", view.picture);
  $("inset").hidden = !outside;
  source("frame", view.frame);
  for (const [id, corners] of [["border", view.border], ["found", view.game]]) {
    $(id).setAttribute("points", outside ? "" : corners.map(each => each.toFixed(4)).join(" "));
  }
  if (!view.found) silent("The screen is not found in this picture.");
  $("score").replaceChildren(`score ${minus(String(view.score))}`, element("small", `step ${view.steps}`));
  // Actions that are not ALE's have no keys.
  $("keys").parentElement.style.visibility = view.keys.length ? "" : "hidden";
  for (const key of $("keys").children) {
    const bit = +key.dataset.key;
    key.classList.toggle("pressed", (view.pressed & bit) > 0);
    key.classList.toggle("wanted", (view.wanted & bit) > 0);
  }
  streams(view.streams);
  showValues(view);
}

function streams(count) {
  $("stream").hidden = count < 2;
  if ($("stream").options.length === count) return;
  const options = Array.from({length: count}, (_, i) => element("option", `environment ${i + 1}`, {value: i}));
  $("stream").replaceChildren(...options);
}

// An action by its keys: an arrow, a dot for fire, a dash for nothing.
function sign(keys) {
  const right = (keys & 8 ? 1 : 0) - (keys & 4 ? 1 : 0), down = (keys & 2 ? 1 : 0) - (keys & 1 ? 1 : 0);
  const arrow = ["↖↑↗", "←·→", "↙↓↘"][down + 1][right + 1];
  return (keys & 15 ? arrow : keys ? "" : "–") + (keys & 16 ? "●" : "");
}

function showValues({values, keys, chosen, explored}) {
  const least = Math.min(...values), span = Math.max(...values) - least || 1;
  $("values").classList.toggle("many", values.length > 9);
  $("values").replaceChildren(...values.map((value, i) => {
    const row = element("li", undefined, {className: i === chosen ? "chosen" : ""}), bar = element("i");
    bar.style.width = `${(value - least) / span * 100}%`;
    row.append(element("span", keys.length ? sign(keys[i]) : String(i)), bar, element("span", minus(value.toFixed(2))));
    return row;
  }));
  text("choice", explored ? "Q-values; this action was random" : "Q-values; the best was chosen");
}

watchRun();
watchActor();

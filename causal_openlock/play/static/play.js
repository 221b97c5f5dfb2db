// The page: instructions, perhaps a practice room, the rooms, the end. What it knows of a room is
// what the server tells after each action; every call says which turn it is for, so that a call that
// is repeated after a broken connection counts once.

import { Room } from "/room.js";

const $ = (id) => document.getElementById(id);
const STORED = "locked-room";
const KEYS = ["Digit1", "Digit2", "Digit3", "Digit4", "Digit5", "Digit6", "Digit7", "Digit8", "Digit9", "Digit0", "Minus", "Equal"];
const LONGEST = 24 * 60 * 60 * 1000; // the longest reaction that is sent
const LOOK = 900; // milliseconds to look at how an attempt ended

let session = null, brief = null, state = null, room = null;
let busy = true, ready = 0;

const wait = (time) => new Promise((done) => setTimeout(done, time));
const count = (many, what) => `${many} ${what}${many === 1 ? "" : "s"}`;

// -- talking to the server --------------------------------------------------------------------

// Call the server until it answers; it may be started again in between. What is between page and
// server, such as a proxy or a hotel's network, can answer too, and not in JSON.
async function call(path, body) {
  for (let pause = 300; ; pause = Math.min(2 * pause, 3000)) {
    try {
      const answer = await fetch(path, {
        method: body ? "POST" : "GET",
        headers: session ? { Authorization: `Bearer ${session}` } : {},
        body: body && JSON.stringify(body),
      });
      if (answer.status < 500) {
        const said = await answer.json().catch((error) => {
          if (!(error instanceof SyntaxError)) throw error;
        });
        $("offline").hidden = true;
        return said ? { status: answer.status, said } : { status: 0, said: { error: `no answer of the study's server (HTTP status ${answer.status})` } };
      }
    } catch (error) {
      if (!(error instanceof TypeError)) throw error; // that is how fetch tells of no connection
    }
    $("offline").hidden = false;
    await wait(pause);
  }
}

// What is needed to continue; where it is refused, the screen says why and nothing follows.
async function got(path) {
  const answer = await call(path);
  if (answer.status === 200) return answer.said;
  refused(answer);
  return new Promise(() => {});
}

// Where the session is stored: people who come with identifiers of their own do not get one another's.
function shelf() {
  const first = recruited()[brief.recruiting[0]];
  return first ? `${STORED} ${first}` : STORED;
}

// A private window or strict settings can forbid storing; the address then still has the session.
function stored(value) {
  try {
    if (value === undefined) return localStorage.getItem(shelf());
    if (value === null) localStorage.removeItem(shelf());
    else localStorage.setItem(shelf(), value);
  } catch { /* forbidden */ }
  return null;
}

function remember(id) {
  session = id;
  stored(id);
  history.replaceState(null, "", id ? `#${id}` : location.pathname + location.search);
}

// A session id: 24 random bytes. Drawn here, so that a call that is repeated joins once.
function newSession() {
  const bytes = crypto.getRandomValues(new Uint8Array(24));
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_");
}

// What the recruiting service has added to the address. A + is meant as one: few services write spaces so.
function recruited() {
  const given = new URLSearchParams(location.search.replaceAll("+", "%2B"));
  return Object.fromEntries(brief.recruiting.map((name) => [name, (given.get(name) ?? "").trim()]));
}

// -- screens ----------------------------------------------------------------------------------

function screen(name, where = "") {
  $("where").textContent = where;
  for (const main of document.querySelectorAll("main")) main.hidden = main.id !== name;
  $("help").hidden = name !== "play";
  const heading = $(name).querySelector("h2");
  if (name !== "play" && heading) {
    heading.tabIndex = -1;
    heading.focus({ preventScroll: true });
  }
}

function intro() {
  const budgets = { levers: count(brief.positions, "lever"), actions: count(brief.action_limits.join(" or "), "action"), attempts: count(brief.attempt_limit, "attempt") };
  for (const node of document.querySelectorAll("[data-brief]")) node.textContent = budgets[node.dataset.brief];
  $("identified").hidden = brief.recruiting.length === 0;
  $("begin").textContent = state ? "Back to the room" : brief.practice ? "Go to the practice room" : "Go to the first room";
  screen("intro");
}

// What people agree to before they begin; only those who have not begun are asked.
function consent() {
  if (!brief.consent) return intro();
  $("consent-text").innerHTML = brief.consent; // made by the server of the study's own text
  screen("consent");
}

// What the person thinks of the room that they have left: a box for each pair of levers.
function question() {
  const { names } = brief.geometry[state.positions], door = state.positions;
  const called = (place) => place === door ? "the lock of the door" : `lever ${place + 1} (${names[place]})`;
  $("ask-levers").replaceChildren(...state.levers.map((lever) => {
    const group = document.createElement("fieldset");
    const legend = Object.assign(document.createElement("legend"), { textContent: `Pushing ${called(lever)} made it possible to move` });
    group.append(legend, ...[...state.levers, door].filter((other) => other !== lever).map((other) => {
      const box = Object.assign(document.createElement("input"), { type: "checkbox" });
      Object.assign(box.dataset, { lever, other });
      const label = Object.assign(document.createElement("label"), { className: "toggle" });
      label.append(box, ` ${called(other)}`);
      return label;
    }));
    return group;
  }));
  $("ask-go").disabled = false;
  screen("ask", `Room ${state.ended.length} of ${state.trials}`);
}

function console_(now) {
  $("solutions").textContent = now.solutions_left;
  $("attempts").textContent = now.attempts_left;
  $("actions").textContent = now.actions_left;
  const dots = $("dots");
  if (dots.childElementCount !== now.action_limit) {
    dots.replaceChildren(...Array.from({ length: now.action_limit }, () => document.createElement("i")));
  }
  [...dots.children].forEach((dot, i) => dot.classList.toggle("left", i < now.actions_left));
}

function say(text, good = false) {
  $("said").textContent = text;
  $("said").classList.toggle("good", good);
}

function occupied(now) {
  busy = now;
  $("room").classList.toggle("busy", now);
  $("help").disabled = now;
  if (!now) ready = performance.now();
}

// A pause between rooms, which ends when the person says so.
function pause(title, text, button, covered = false) {
  $("pause-title").textContent = title;
  $("pause-text").textContent = text;
  $("pause-go").textContent = button;
  $("pause").classList.toggle("covered", covered);
  $("help").disabled = false;
  paused(true);
  $("pause-go").focus();
  return new Promise((done) => {
    $("pause-go").onclick = () => {
      paused(false);
      done();
    };
  });
}

function paused(now) {
  $("pause").hidden = !now;
  for (const part of ["room", "practice"]) $(part).inert = now;
}

// Show the state as it is, from nothing.
async function enter() {
  paused(false);
  if (state.stage === "question") return question();
  if (state.stage === "end") return end();
  room = new Room($("room"), brief.geometry[state.positions], act);
  room.number($("keys").checked);
  $("last-key").textContent = "1234567890-="[state.positions - 1];
  $("practice").hidden = state.stage !== "practice";
  screen("play");
  await begin(state.stage === "practice" || state.room.attempt > 1 || state.room.actions_left < state.room.action_limit);
}

async function begin(at_once) {
  const now = state.room, practice = state.stage === "practice";
  $("where").textContent = practice ? "Practice room" : `Room ${now.trial} of ${state.trials}`;
  room.show(now.observation);
  console_(now);
  say("");
  occupied(true);
  if (practice && now.over) {
    // The room has gone back, and there is nothing left to count.
    for (const name of ["solutions", "attempts", "actions"]) $(name).textContent = "–";
    $("dots").replaceChildren();
    say("That is all there is to practice.");
    $("help").disabled = false;
    $("proceed").focus();
    return;
  }
  const left = now.solutions_left;
  const all = left === 1 ? "the one combination that opens" : `all ${count(left, "combination")} that open`;
  const [what, go] = now.shown === undefined
    ? [`Find ${all} this door. You have ${count(now.attempts_left, "attempt")}.`, "Start"]
    : [`Here you only watch: the arm shows you ${all} this door.`, "Watch"];
  if (!at_once) await pause(`Room ${now.trial} of ${state.trials}`, what, go, true);
  return next();
}

// What comes next: the person acts, or the arm shows what to do.
async function next() {
  if (state.room.shown === undefined) return occupied(false);
  await wait(LOOK);
  return take(state.room.shown, null);
}

function end() {
  const played = state.ended.filter((trial) => !trial.shown);
  const solved = played.filter((trial) => trial.left === 0).length;
  const rooms = solved === played.length ? "every room" : `${solved} of ${count(played.length, "room")}`;
  $("outcome").textContent = `You found every combination in ${rooms}.`;
  $("rooms").replaceChildren(...state.ended.map(({ attempts, found, left, shown }, i) => {
    const row = document.createElement("tr");
    const texts = shown ? [i + 1, "shown to you", "–"] : [i + 1, `${found} of ${found + left}`, attempts];
    for (const text of texts) row.insertCell().textContent = text;
    return row;
  }));
  // Nothing is asked of the server any more: it may be stopped as soon as everybody has finished.
  $("back").hidden = !state.completion;
  if (state.completion) $("back-link").href = state.completion;
  $("another").hidden = brief.recruiting.length > 0; // they come by an address of their own
  screen("end");
}

// -- acting -----------------------------------------------------------------------------------

async function act(action) {
  if (!busy) return take(action, Math.min(Math.round(performance.now() - ready), LONGEST));
}

async function take(action, reaction) {
  occupied(true);
  say("");
  // The arm sets out at once; what comes of it is known when it arrives.
  const [answer] = await Promise.all([
    call("/turn", { turn: state.turn, action, reaction }),
    room.approach(action),
  ]);
  if (answer.status !== 200) return adopt(answer);
  const said = answer.said;
  const before = state.room;
  console_({
    ...before,
    solutions_left: said.solutions_left,
    // A trial that is over before its attempts are spent has none left to count.
    attempts_left: !said.trial_over ? before.attempts_left : before.attempts_left > 1 ? "–" : 0,
    actions_left: said.attempt_over ? 0 : said.next.room.actions_left,
  });
  await room.carryOut(action, said.outcome);
  const unlocked = before.observation.at(-2) && !said.outcome.at(-2);
  const locked = !before.observation.at(-2) && said.outcome.at(-2);
  const opened = said.outcome.at(-1) === 1;
  if (opened) say(said.new_solution ? "The door is open: a new combination!" : "The door is open, but by no new combination.", said.new_solution);
  else if (unlocked) say("The door is unlocked.");
  else if (locked) say("The door is locked again.");
  else if (!said.moved) say("Nothing moved.");
  state = said.next;
  if (!said.attempt_over) {
    state.room.observation = said.outcome;
    return next();
  }
  if (!opened) say(`${$("said").textContent} The attempt is over; the room goes back.`.trim());
  await wait(LOOK);
  if (!said.trial_over) {
    await room.reset(state.room.observation);
    console_(state.room);
    return next();
  }
  if (state.stage === "practice") {
    await room.reset(state.room.observation);
    return begin(true);
  }
  const left = said.solutions_left, asked = state.stage === "question";
  const last = state.stage === "end" || (asked && state.ended.length === state.trials);
  if (before.shown !== undefined) {
    await pause("You have seen every combination", "On to what comes next.", "Next room");
  } else await pause(
    left ? "No attempts are left" : "You found every combination!",
    left ? `${count(left, "combination")} stayed hidden. Never mind: on to what comes next.` : `It took you ${count(before.attempt, "attempt")}.`,
    asked ? "Go on" : last ? "Finish" : "Next room",
  );
  if (asked) return question();
  if (last) return end();
  await room.reset(state.room.observation);
  return begin(false);
}

// Take a turn that moves nothing, and show what comes next.
async function turn(what) {
  const answer = await call("/turn", { turn: state.turn, ...what });
  if (answer.status !== 200) return adopt(answer);
  state = answer.said;
  return enter();
}

// The server says that this is not how things are: take over how they are.
async function adopt(answer) {
  if (!answer.said.now) return refused(answer);
  state = answer.said.now;
  await enter();
  return say("This session went on elsewhere; this is where it is now.");
}

// The server, or what is before it, says no. It gives a title to what it says itself.
function refused({ status, said }) {
  if (status === 404 && said.title) {
    // A wrong address does not end the session that this browser has stored.
    if (stored() === session) stored(null);
    history.replaceState(null, "", location.pathname + location.search);
  }
  $("trouble-title").textContent = said.title ?? "The study cannot be reached as it should";
  $("trouble-text").textContent = said.title ? said.error
    : `This page was told: ${said.error ?? "no"}. Please try again. If it stays so, please tell the person who invited you. Nothing you did before is lost.`;
  screen("trouble");
}

// -- what can be pressed ----------------------------------------------------------------------

$("begin").onclick = async () => {
  if (!state) {
    const begun = stored(); // in another tab, since this one was opened
    remember(begun ?? newSession()); // first: the page may be loaded again before the answer comes
    $("begin").disabled = true;
    const answer = await (begun ? call("/state") : call("/join", { agreed: brief.consent_mark, recruited: recruited() }));
    $("begin").disabled = false;
    if (answer.status !== 200) {
      if (!begun) remember(null);
      return refused(answer);
    }
    state = answer.said;
  }
  await enter();
};
$("trouble-go").onclick = () => location.reload();
$("help").onclick = () => {
  busy = true;
  intro();
};
$("agree").onchange = () => { $("consent-go").disabled = !$("agree").checked; };
$("consent-go").onclick = intro;
$("ask-go").onclick = () => {
  $("ask-go").disabled = true;
  const ticked = [...$("ask-levers").querySelectorAll("input:checked")];
  const edges = ticked.map(({ dataset }) => [Number(dataset.lever), Number(dataset.other)]);
  return turn({ edges });
};
$("proceed").onclick = () => {
  if (busy && !state.room.over) return;
  occupied(true);
  return turn({});
};
$("another").onclick = () => {
  remember(null);
  location.reload();
};
$("keys").onchange = () => room?.number($("keys").checked);
document.addEventListener("keydown", (event) => {
  if (busy || $("play").hidden || !$("keys").checked) return;
  if (event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
  const many = state.positions, place = KEYS.indexOf(event.code.replace("Numpad", "Digit"));
  // A letter that is not Latin, such as a Cyrillic one, is taken for that of the key's place.
  const letter = /^[a-z]$/i.test(event.key) ? event.key : event.code.replace("Key", "");
  // On a number pad, Windows hides Shift behind what the key does with it.
  const hidden = event.code.startsWith("Numpad") && event.getModifierState("NumLock") && !/[0-9]/.test(event.key);
  if (letter.toLowerCase() === "d") act(2 * many);
  else if (place >= 0 && place < many) act(event.shiftKey || hidden ? many + place : place);
});

async function start() {
  brief = await got("/brief");
  // What else stands behind a # has been added on the way here, such as #_=_ by Facebook.
  session = /^#[\w-]{32}$/.test(location.hash) ? location.hash.slice(1) : stored();
  if (!session) return consent();
  state = await got("/state");
  remember(session);
  return enter();
}

window.addEventListener("hashchange", () => location.reload());
await start();

// The panel: which swimmers are on, sliders, options, and the numbers beside them. The keys press the same things.

const WORDS = ["", "", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];
const element = (id) => document.getElementById(id);

export class Panel {
  /** `clock` has playing, pace; `changed` is called when something else than time has changed what is to be seen. */
  constructor(arena, clock, palette, changed) {
    Object.assign(this, { arena, clock, palette, changed });
    element("play").addEventListener("click", () => this.toggle());
    element("step").addEventListener("click", () => this.stepOnce());
    element("reset").addEventListener("click", () => this.act(() => arena.reset()));
    element("random").addEventListener("click", () => this.act(() => arena.randomStart()));
    element("push").addEventListener("click", () => this.act(() => arena.kick()));
    element("as-learned").addEventListener("click", () => {
      this.set("friction", 0);
      this.set("torque", 1);
    });
    for (const id of ["pace", "friction", "torque"]) element(id).addEventListener("input", () => this.readSliders());
    for (const id of ["trails", "torques"]) element(id).addEventListener("change", changed);
    this.offerLinks();
    this.showPolicies();
    this.readSliders();
    this.showPlaying();
  }

  get options() {
    return { trails: element("trails").checked, torques: element("torques").checked };
  }

  act(action) {
    action();
    this.changed();
  }

  toggle(playing = !this.clock.playing) {
    this.clock.playing = playing;
    this.showPlaying();
    this.changed();
  }

  stepOnce() {
    this.toggle(false);
    this.act(() => this.arena.step());
  }

  showPlaying() {
    const { playing } = this.clock;
    element("play").querySelector("span").textContent = playing ? "Pause" : "Play";
    element("play").querySelector("path").setAttribute("d", playing ? "M6 4.5h4v15H6zM14 4.5h4v15h-4z" : "M7 4.5v15l12-7.5z");
  }

  /** Put a slider somewhere, as if it had been moved there. */
  set(id, value) {
    element(id).value = value;
    this.readSliders();
  }

  readSliders() {
    const { arena, clock } = this;
    const number = (id) => Number(element(id).value);
    clock.pace = 10 ** number("pace");
    const [friction, torque] = [10 ** number("friction"), number("torque")];
    if (friction !== arena.scale.friction || torque !== arena.scale.torque) arena.setScale({ friction, torque });
    this.showSliders();
    this.changed();
  }

  showSliders() {
    const { arena, clock } = this;
    const { viscous_friction: k, torque_limit: limits } = arena.racers[0].policy.parameters;
    const say = (id, text) => {
      element(`${id}-now`).textContent = text;
      element(id).setAttribute("aria-valuetext", text);
    };
    const strongest = Math.max(...limits);
    say("pace", `${clock.pace < 1 ? clock.pace.toFixed(2) : clock.pace.toFixed(1)} ×`);
    say("friction", `${(k * arena.scale.friction).toPrecision(2)} N·s/m²`);
    say("torque", `${(strongest * arena.scale.torque).toFixed(2)} N·m`);
  }

  offerLinks() {
    const counts = [...new Set(this.arena.policies.map((policy) => policy.links))].sort((a, b) => a - b);
    element("links").replaceChildren(...counts.map((links) => {
      const input = Object.assign(document.createElement("input"), { type: "radio", name: "links", value: links });
      input.addEventListener("change", () => this.chooseLinks(links));
      const label = document.createElement("label");
      label.append(input, String(links));
      return label;
    }));
  }

  /** All swimmers of so many links that there are, in the water. */
  chooseLinks(links) {
    const names = this.arena.policiesOf(links).map((policy) => policy.name);
    if (names.length > 0) this.choose(names);
  }

  choose(names) {
    this.arena.choose(names);
    this.showPolicies();
    this.showSliders();
    this.changed();
  }

  /** Each swimmer of this number of links alone, one after the other, then all. */
  chooseNext() {
    const names = this.arena.policiesOf(this.arena.links).map((policy) => policy.name);
    const on = this.arena.racers.map((racer) => racer.policy.name);
    const next = on.length > 1 ? 0 : names.indexOf(on[0]) + 1;
    this.choose(next < names.length ? [names[next]] : names);
  }

  showPolicies() {
    const { arena } = this;
    for (const input of element("links").querySelectorAll("input")) input.checked = Number(input.value) === arena.links;
    element("links-word").textContent = WORDS[arena.links] ?? String(arena.links);
    const offered = arena.policiesOf(arena.links);
    element("race").hidden = offered.length < 2;
    element("policies").replaceChildren(...offered.map((policy) => {
      const row = document.createElement("tr");
      const box = Object.assign(document.createElement("input"), { type: "checkbox", value: policy.name });
      box.checked = arena.racers.some((racer) => racer.policy === policy);
      box.style.accentColor = `var(--racer-${arena.colorOf(policy)})`;
      box.addEventListener("change", () => this.readPolicies(box));
      const label = document.createElement("label");
      label.append(box, policy.label);
      const cells = [label, "–", policy.speed.toFixed(2)].map((content) => {
        const cell = document.createElement("td");
        cell.append(content);
        return cell;
      });
      cells[1].style.color = `var(--racer-${arena.colorOf(policy)})`;
      if (policy.ci95) cells[2].title = `95 % interval over starts: ${policy.ci95.map((bound) => bound.toFixed(3)).join(" to ")}`;
      row.dataset.name = policy.name;
      row.append(...cells);
      return row;
    }));
  }

  /** The boxes were changed by a person; one stays on. */
  readPolicies(changed) {
    const boxes = [...element("policies").querySelectorAll("input")];
    if (!boxes.some((box) => box.checked)) changed.checked = true;
    this.choose(boxes.filter((box) => box.checked).map((box) => box.value));
    element("policies").querySelector(`input[value="${CSS.escape(changed.value)}"]`).focus();
  }

  /** What changes as time goes on. */
  showNumbers() {
    const { arena, palette } = this;
    for (const row of element("policies").rows) {
      const racer = arena.racers.find(({ policy }) => policy.name === row.dataset.name);
      const mean = racer?.meanSpeed ?? null;
      row.cells[1].textContent = inTwoDigits(mean);
    }
    const show = (key) => {
      element(`now-${key}`).replaceChildren(...arena.racers.map((racer) => {
        const now = document.createElement("span");
        now.style.color = palette().racers[racer.color];
        now.textContent = inTwoDigits(racer.samples.at(-1)?.[key]);
        return now;
      }));
    };
    for (const key of ["speed", "value", "hamiltonian"]) show(key);
    const { winner } = arena;
    element("message").textContent = winner && arena.racers.length > 1 ? `There first: ${winner.policy.label}` : "";
  }
}

/** A number as it is read, with a minus sign and not a hyphen; a dash where there is none. */
function inTwoDigits(value) {
  return value === null || value === undefined ? "–" : value.toFixed(2).replace("-", "−");
}

/** Keys; what is typed into a control stays there. */
export function listenToKeys(panel, arena) {
  const down = new Set();
  const arrows = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const press = {
    " ": () => panel.toggle(),
    ".": () => panel.stepOnce(),
    0: () => panel.act(() => arena.reset()),
    r: () => panel.act(() => arena.randomStart()),
    p: () => panel.act(() => arena.kick()),
    m: () => panel.chooseNext(),
    t: () => element("trails").click(),
    u: () => element("torques").click(),
    "[": () => panel.set("pace", Number(element("pace").value) - 0.1),
    "]": () => panel.set("pace", Number(element("pace").value) + 0.1),
  };
  for (let links = 2; links < 10; links++) press[links] = () => panel.chooseLinks(links);
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const { target } = event;
    const inControl = target instanceof Element && target.matches("input[type=range], input[type=radio]");
    const pressesItself = target instanceof Element && target.matches("button, input, summary, a");
    if (event.key in arrows && !inControl) {
      down.add(event.key);
      const [x, y] = [...down].reduce(([a, b], key) => [a + arrows[key][0], b + arrows[key][1]], [0, 0]);
      if (x !== 0 || y !== 0) panel.act(() => arena.swimTowards(Math.atan2(y, x)));
    } else if (event.key.toLowerCase() in press && !(event.key === " " && pressesItself)) {
      press[event.key.toLowerCase()]();
    } else return;
    event.preventDefault();
  });
  window.addEventListener("keyup", (event) => down.delete(event.key));
  window.addEventListener("blur", () => down.clear());
}

import { render } from "preact";
import { connect, Model } from "./model.ts";
import { Page } from "./page.tsx";

const model = new Model();
render(<Page model={model} />, document.getElementById("page") as HTMLElement);
connect(model);

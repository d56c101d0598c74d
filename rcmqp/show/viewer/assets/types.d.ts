/** What scripts find in the browser besides their own modules: libraries, and the page's handle. */

import type { Object3D, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";

declare global {
  /** Meshcat's viewer, as far as it is used here. */
  interface MeshcatViewer {
    scene: Scene;
    renderer: WebGLRenderer;
    gui: { domElement: HTMLElement };
    scene_tree: { find(path: string[]): { object: Object3D } };
    controls: { target: Vector3; update(): void; dispose(): void };
    needs_render: boolean;
    set_3d_pane_size(): void;
    delete_path(path: string[]): void;
    set_property(path: string[], property: string, value: unknown): void;
    set_camera(camera: PerspectiveCamera): void;
    handle_command_bytearray(command: Uint8Array): void;
    render(): void;
  }

  /** It defines this while it runs as a script: see meshcat.js. */
  const MeshCat: {
    THREE: typeof import("three");
    Viewer: new (pane: HTMLElement, animate: boolean) => MeshcatViewer;
  };

  interface PlotlyAxis {
    _offset: number;
    _length: number;
    p2l(pixel: number): number;
    l2p(value: number): number;
  }

  interface PlotlyFigure extends HTMLElement {
    _fullLayout: Record<string, PlotlyAxis>;
    on(event: string, act: () => void): void;
  }

  const Plotly: {
    react(figure: HTMLElement, traces: object[], layout: object, config: object): Promise<void>;
  };

  interface Uint8ArrayConstructor {
    /** Missing in browsers before 2025. */
    fromBase64?(text: string): Uint8Array<ArrayBuffer>;
  }

  interface Window {
    rcmqp: object;
  }
}
